"""A recorded belief bag as a :class:`Record`."""

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from semantic_slam.bag.names import absolute
from semantic_slam.bag.reader import BagReader
from semantic_slam.errors import InputError
from semantic_slam.evaluation.record import GroundTruth, Record
from semantic_slam.evaluation.trajectory import Trajectory
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.protocol import LOST, RunConfiguration
from semantic_slam.inference.relocation.carried_spans import Spans, spans_of
from semantic_slam.messages import topics
from semantic_slam.messages.codec import decode
from semantic_slam.messages.ground_truth import GroundTruthObjects
from semantic_slam.messages.node_status import CARRIED_IN
from semantic_slam.messages.standard import OdometryEstimate
from semantic_slam.messages.typestore import deserialize
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.pipeline.stamps.topic_clock import TopicClock

READ = tuple(
    absolute(topic)
    for topic in (
        topics.RUN_CONFIGURATION,
        topics.BELIEF,
        topics.MEASUREMENTS,
        topics.ODOMETRY,
        topics.DIAGNOSTICS,
        topics.GROUND_TRUTH_ODOMETRY,
        topics.GROUND_TRUTH_OBJECTS,
        topics.GROUND_TRUTH_ASSOCIATIONS,
    )
)
BELIEF_FOLDER = "belief"
"""Subfolder of a report with its belief bag."""
DROPPED = "dropped"
"""Diagnostic values whose key begins with this word count what was dropped; the rest of the key is the reason."""


@dataclass
class _Collected:
    run: RunConfiguration | None = None
    beliefs: dict[int, HybridBelief] = field(default_factory=dict)
    measurements: dict[int, SemanticMeasurements] = field(default_factory=dict)
    odometry: dict[int, Any] = field(default_factory=dict)
    true_odometry: dict[int, Any] = field(default_factory=dict)
    true_objects: GroundTruthObjects | None = None
    true_associations: dict[int, tuple[str, ...]] = field(default_factory=dict)
    dropped: dict[tuple[str, str], int] = field(default_factory=dict)  # (node, reason) -> newest count
    carried: Spans = ()
    dropped_before: Counter[tuple[str, str]] = field(default_factory=Counter)  # likewise, by processes that ended

    def take(self, topic: str, type_name: str, raw: bytes) -> None:
        if topic == topics.DIAGNOSTICS:
            message = deserialize(raw, type_name)
            self._count_dropped(_dropped(message))
            self.carried = _carried(message) or self.carried
            return
        value = decode(raw, type_name)
        if isinstance(value, HybridBelief):
            self.beliefs[value.keyframe] = value
        elif isinstance(value, RunConfiguration):
            self.run = value
        elif isinstance(value, SemanticMeasurements):
            self.measurements[value.stamp_ns] = value
        elif isinstance(value, OdometryEstimate):
            track = self.true_odometry if topic == topics.GROUND_TRUTH_ODOMETRY else self.odometry
            track[value.stamp_ns] = value.pose
        elif isinstance(value, GroundTruthObjects):
            self.true_objects = value
        else:
            self.true_associations[value.stamp_ns] = value.object_ids

    def _count_dropped(self, counts: dict[tuple[str, str], int]) -> None:
        """Take newer counts; one below that before is of a node that was started again and counts from zero."""
        for key, count in counts.items():
            before = self.dropped.get(key, 0)
            self.dropped_before[key] += before if count < before else 0
            self.dropped[key] = count

    def truth(self) -> GroundTruth | None:
        if not self.true_odometry and self.true_objects is None and not self.true_associations:
            return None
        return GroundTruth(_trajectory(self.true_odometry), self.true_objects, self.true_associations)

    def reasons(self, beliefs: tuple[HybridBelief, ...]) -> dict[str, int]:
        """What was dropped, by reason: as diagnostics name them; inputs else as the last belief counted them."""
        reasons: dict[str, int] = {}
        for key, count in self.dropped.items():
            reasons[key[1]] = reasons.get(key[1], 0) + count + self.dropped_before[key]
        total = beliefs[-1].dropped
        if total and all(reason.startswith(LOST) for reason in reasons):
            reasons["reason not recorded"] = total
        return reasons


def belief_bag(path: str | Path) -> Path:
    """Path of the belief bag: that in a report's folder, or ``path`` itself."""
    inside = Path(path) / BELIEF_FOLDER
    return inside if inside.is_dir() else Path(path)


def read_record(path: str | Path) -> Record:
    """The run in the belief bag ``path``, or in that of the report's folder ``path``.

    A bag that cannot be read to its end gives what came before, and its ``fault``. Raises InputError when the bag holds
    no belief or no run configuration.
    """
    path = belief_bag(path)
    found, fault = _Collected(), ""
    try:
        with BagReader(path) as reader:
            fault = reader.unfinished
            for topic, type_name, _, raw in reader.messages(READ):
                found.take(absolute(topic), type_name, raw)
    except InputError as error:
        if not found.beliefs:
            raise
        fault = str(error)
    if not found.beliefs:
        raise InputError(
            f"{path}: holds no message on {topics.BELIEF}; run semantic_slam report {path} --out DIR first, and give"
            " DIR"
        )
    if found.run is None:
        raise InputError(f"{path}: holds no {topics.RUN_CONFIGURATION}; record that topic together with the beliefs")
    beliefs = tuple(found.beliefs[k] for k in sorted(found.beliefs))
    odometry = _trajectory(_believed(found.odometry))
    return Record(
        found.run,
        beliefs,
        odometry,
        found.measurements,
        found.truth(),
        found.reasons(beliefs),
        fault,
        found.carried,
    )


def _trajectory(poses: dict[int, Any]) -> Trajectory:
    """The poses in stamp order; what is no pose (NaN, no rotation) is left out, as the pipeline does."""
    stamps = sorted(stamp for stamp, pose in poses.items() if np.isfinite(pose).all() and pose[3:].any())
    return Trajectory(np.array(stamps, dtype=np.int64), np.array([poses[stamp] for stamp in stamps]).reshape(-1, 7))


def _believed(poses: dict[int, Any]) -> dict[int, Any]:
    """Odometry poses whose stamps the pipeline believes; a single wrong one would bend the dead reckoning."""
    clock: TopicClock[Any] = TopicClock(topics.ODOMETRY, Counter())
    believed: dict[int, Any] = {}
    for stamp, pose in poses.items():
        taken = clock.take(stamp, pose)
        if clock.withdrawn_from_ns is not None:
            believed = {time: kept for time, kept in believed.items() if time < clock.withdrawn_from_ns}
        believed.update(taken)
    return {**believed, **dict(clock.release())}


def _dropped(message: Any) -> dict[tuple[str, str], int]:
    """(node, reason) -> count of one diagnostics message, since the node was started."""
    counts = {}
    for status in message.status:
        for item in status.values:
            word, _, reason = item.key.partition(" ")
            if word.rstrip(":") == DROPPED and item.value.isdigit():
                counts[status.name, reason.strip() or DROPPED] = int(item.value)
    return counts


def _carried(message: Any) -> Spans:
    """Keyframes so far in which the robot was taken for carried, by one diagnostics message."""
    values = [item.value for status in message.status for item in status.values if item.key == CARRIED_IN]
    try:
        return spans_of(values[-1]) if values else ()
    except ValueError:
        return ()
