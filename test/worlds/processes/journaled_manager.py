"""A hypothesis manager in this process, with journal and snapshots, whose backends keep keyframes as nodes have them."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from semantic_slam.configuration import Configuration
from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import planar_from_pose_vector, pose_vector_from_planar
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.protocol import Candidates, RunConfiguration
from semantic_slam.messages import topics
from semantic_slam.messages.codec import encode, from_message
from semantic_slam.messages.standard import OdometryEstimate
from semantic_slam.messages.typestore import deserialize
from semantic_slam.pipeline.assembly.frame_count import FrameCount
from semantic_slam.pipeline.journal.event_journal import EventJournal
from semantic_slam.pipeline.journal.journal import SNAPSHOT
from semantic_slam.pipeline.journal.journal_of_run import open_journal
from semantic_slam.pipeline.journal.journaled_pool import JournaledPool
from semantic_slam.pipeline.journal.kept_run import KeptRun
from semantic_slam.pipeline.journal.kept_runs import KeptRuns
from semantic_slam.pipeline.journal.snapshots import Snapshots
from semantic_slam.pipeline.session import Session

Event = tuple[str, bytes]


class KeepingPool(InProcessPool):
    """Backends of this process; new ones are told the keyframes that were kept, as nodes are that ask for them."""

    def __init__(self, number: int = 1) -> None:
        super().__init__(number)
        self.runs, self.kept = KeptRuns(), None

    def start(self, run: RunConfiguration) -> None:
        super().start(run)
        self.kept: KeptRun | None = self.runs.begin(run)
        for keyframe in self.kept.keyframes(0, self.kept.num_keyframes):
            super().tell(keyframe)

    def tell(self, keyframe: Keyframe) -> None:
        super().tell(keyframe)
        self.kept.add(keyframe)

    def expand(self, keyframe: Keyframe) -> list[Candidates]:
        self.kept.add(keyframe)
        return super().expand(keyframe)


class LivingPool(KeepingPool):
    """The backends of a manager that was killed, as another one finds them."""

    def __init__(self, pool: KeepingPool) -> None:
        self.backend_ids, self._backends = pool.backend_ids, pool._backends
        self.runs, self.kept = KeptRuns(), None

    def start(self, run: RunConfiguration) -> None:
        self.kept = self.runs.begin(run)

    def tell(self, keyframe: Keyframe) -> None:
        self.kept.add(keyframe)


class Manager:
    """Handles messages as the node does; ``beliefs`` by keyframe, of this process alone."""

    STATE: ClassVar[tuple[str, ...]] = ("frames",)

    def __init__(self, folder: Path, configuration: Configuration, pool: KeepingPool | None = None) -> None:
        self.pool = KeepingPool() if pool is None else pool
        self.journal = open_journal(str(folder), configuration, None, "", resume=True)
        self.events = EventJournal(self.journal, {SNAPSHOT: lambda _: self.snapshots.pass_by(self.session)})
        self.snapshots = Snapshots(self.journal, configuration.history, self.pool)
        self.session = Session(configuration, None, "")
        self.frames = FrameCount()
        self.beliefs: dict[int, HybridBelief] = {}
        self.num_replayed = 0
        for topic, take in ((topics.ODOMETRY, self._odometry), (topics.MEASUREMENTS, self._measurements)):
            self.events.listen(topic, lambda data, take=take, topic=topic: self._use(take, topic, data))
        journaled = JournaledPool(self.pool, self.journal)
        self._infer = lambda: self.session.beliefs(journaled)
        self.snapshots.restore(self, self.session, journaled)
        for event in self.events.past():
            self.events.happen_again(event)
            self.num_replayed += 1

    def receive(self, event: Event) -> None:
        self.events.happen(*event)
        self.snapshots.take(self, self.session)

    def close(self) -> None:
        """End, as a killed process does: the files are closed as they are."""
        self.journal.close()

    def _use(self, take: Any, topic: str, data: bytes) -> None:
        take(deserialize(data, topics.TYPES[topic]))
        for keyframe, belief in self._infer():
            self.beliefs[keyframe.index] = belief
            self.snapshots.count()

    def _odometry(self, message: Any) -> None:
        self.session.assembler.add_odometry(message)

    def _measurements(self, message: Any) -> None:
        measured = self.frames.measured(from_message(message))
        if measured is not None:
            self.session.assembler.add_measurements(measured)


def events_of(keyframes: Sequence[Keyframe]) -> Iterator[Event]:
    """Messages of odometry and measurements that make these keyframes: each its own, and odometry half-way to it."""
    pose, before_ns = np.zeros(3), 0
    for keyframe in keyframes:
        motion = planar_from_pose_vector(keyframe.odometry)
        for share in (0.5, 1.0):
            stamp_ns = before_ns + round(share * (keyframe.stamp_ns - before_ns))
            yield topics.ODOMETRY, encode(_odometry(stamp_ns, se2.compose(pose, share * motion)))
        pose, before_ns = se2.compose(pose, motion), keyframe.stamp_ns
        told = replace(keyframe.measurements, stamp_ns=keyframe.stamp_ns, sequence=keyframe.index)
        yield topics.MEASUREMENTS, encode(told)


def _odometry(stamp_ns: int, pose: Array) -> OdometryEstimate:
    return OdometryEstimate(stamp_ns, "odom", "base_link", pose_vector_from_planar(pose), np.zeros((6, 6)))
