"""A recorded run beside its truth, detection by detection: what the scores of a drive are computed from."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.evaluation.association import CLUTTER
from semantic_slam.evaluation.evaluate import Evaluation, evaluate
from semantic_slam.evaluation.history import best_index, histories
from semantic_slam.evaluation.record import GroundTruth, Record
from semantic_slam.evaluation.trajectory import RigidMotion, alignment
from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.geometry.pose import planar_from_pose_vector
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.messages.ground_truth import MOVING

LEAST_EXISTENCE = 0.5


@dataclass(frozen=True, kw_only=True)
class Stated:
    """O objects that the belief at the end holds for real: existence above one half."""

    ids: Index  # (O,)
    positions: Array  # (O, 2) in map
    moves: Flags  # (O,) whether it is said to move


@dataclass(frozen=True, kw_only=True)
class Judged:
    """K keyframes, N detections of which the truth is known, H hypotheses at the end; all poses planar, in map."""

    record: Record
    truth: GroundTruth
    evaluation: Evaluation
    path: Array  # (K, 3) as it stands at the end
    true_path: Array  # (K, 3) NaN where not known
    weights: Array  # (H,)
    objects: Index  # (H, N) object of every detection
    best: int  # hypothesis
    names: tuple[str, ...]  # (N,) true object, "" for none
    keyframes: Index  # (N,) of every detection
    detection_ids: Index  # (N,) of every detection, within its frame
    stated: Stated

    @property
    def estimate(self) -> list[int]:
        """(N,) object of every detection under the hypothesis that is best at the end."""
        found: list[int] = self.objects[self.best].tolist()
        return found

    @property
    def aligning(self) -> RigidMotion:
        """What brings the path, and what was mapped from it, closest to the truth."""
        return alignment(self.path[:, :2], self.true_path[:, :2])

    @property
    def has_poses(self) -> bool:
        """Whether the drive's poses are known."""
        return bool(np.isfinite(self.true_path).any())

    @property
    def fixed(self) -> dict[str, Array]:
        """True id -> (2,) position of every object that stands still."""
        objects = self.truth.objects
        if objects is None:
            return {}
        rows = zip(objects.object_ids, objects.poses[:, :2], strict=True)
        return {name: position for name, position in rows if not name.startswith(MOVING)}

    @property
    def seen_fixed(self) -> dict[str, Array]:
        """:attr:`fixed`, those of which there is a detection."""
        seen = set(self.names)
        return {name: position for name, position in self.fixed.items() if name in seen}

    def numbers(self) -> Index:
        """(N,) a number for every true object, -1 for none."""
        number: dict[str, int] = {"": CLUTTER}
        return np.array([number.setdefault(name, len(number) - 1) for name in self.names], dtype=int)


def judged(record: Record, path: Array) -> Judged:
    """``record`` with its truth; ``path`` (K, 3) is the robot's as it stands at the end."""
    truth, beliefs = record.truth, record.beliefs
    assert truth is not None  # every importer of a drive writes what is known
    evaluation = evaluate(record, truth)
    objects, names, keyframes, ids = [], [], [], []
    for number, (belief, found) in enumerate(zip(beliefs, histories(beliefs), strict=True)):
        known = truth.associations.get(belief.stamp_ns)
        if known is not None:
            objects.append(found)
            names += [known[row] for row in belief.detection_ids]
            keyframes += [number] * len(belief.detection_ids)
            ids += belief.detection_ids.tolist()
    last = beliefs[-1]
    return Judged(
        record=record,
        truth=truth,
        evaluation=evaluation,
        path=path,
        true_path=planar_from_pose_vector(evaluation.true_poses),
        weights=np.exp(last.log_weights),
        objects=np.hstack(objects) if objects else np.zeros((len(last.log_weights), 0), dtype=int),
        best=best_index(last),
        names=tuple(names),
        keyframes=np.array(keyframes, dtype=int),
        detection_ids=np.array(ids, dtype=int),
        stated=stated(last),
    )


def stated(belief: HybridBelief) -> Stated:
    """The objects that ``belief`` holds for real."""
    rows = np.flatnonzero(belief.existence > LEAST_EXISTENCE)
    return Stated(
        ids=belief.object_ids[rows].astype(int),
        positions=belief.object_poses[rows, :2],
        moves=np.nan_to_num(belief.moving[rows]) > 0.5,
    )


def votes(names: Sequence[str], estimate: Sequence[int]) -> dict[int, str]:
    """Object -> true id of most of its detections, of two with as many the one seen first; those of nothing apart."""
    counts: dict[int, dict[str, int]] = {}
    for name, number in zip(names, estimate, strict=True):
        if name and number > CLUTTER:
            own = counts.setdefault(number, {})
            own[name] = own.get(name, 0) + 1
    return {number: max(own, key=lambda name: own[name]) for number, own in counts.items()}
