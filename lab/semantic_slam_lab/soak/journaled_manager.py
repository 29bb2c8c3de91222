"""A hypothesis manager in this process, with its journal, whose backends keep keyframes as those of nodes do."""

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from semantic_slam.configuration import Configuration, HistoryConfiguration
from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import planar_from_pose_vector, pose_vector_from_planar
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.protocol import Candidates, RunConfiguration
from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam.messages import topics
from semantic_slam.messages.codec import encode, from_message
from semantic_slam.messages.standard import OdometryEstimate
from semantic_slam.messages.typestore import deserialize
from semantic_slam.pipeline.assembly.frame_count import FrameCount
from semantic_slam.pipeline.journal.event_journal import EventJournal
from semantic_slam.pipeline.journal.journal import SNAPSHOT, Journal
from semantic_slam.pipeline.journal.journal_of_run import open_journal
from semantic_slam.pipeline.journal.journaled_pool import JournaledPool
from semantic_slam.pipeline.journal.kept_run import KeptRun
from semantic_slam.pipeline.journal.kept_runs import KeptRuns
from semantic_slam.pipeline.journal.snapshots import Snapshots
from semantic_slam.pipeline.session import Session

Event = tuple[str, bytes]
"""Topic and serialised message."""


class KeepingPool(InProcessPool):
    """Backends of this process; new ones are told the keyframes that were kept, as nodes are that ask for them."""

    kept: KeptRun

    def __init__(self, number: int = 1) -> None:
        super().__init__(number)
        self.runs = KeptRuns()

    def start(self, run: RunConfiguration) -> None:
        super().start(run)
        self.kept = self.runs.begin(run)
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
        self.runs = KeptRuns()

    def start(self, run: RunConfiguration) -> None:
        """They know the run."""
        self.kept = self.runs.begin(run)

    def tell(self, keyframe: Keyframe) -> None:
        """They know the keyframe."""
        self.kept.add(keyframe)


class Manager:
    """Handles messages as the node does; ``beliefs`` by keyframe, of this process alone.

    Made on the folder of another one that was killed it goes on from there.
    """

    STATE: ClassVar[tuple[str, ...]] = ("frames",)

    def __init__(
        self,
        folder: Path,
        configuration: Configuration,
        pool: KeepingPool | None = None,
        *,
        map_prior: MapPrior | None = None,
        snapshots: bool = True,
    ) -> None:
        """``snapshots`` False: the journal is not begun anew. Raises InputError."""
        self.pool = KeepingPool() if pool is None else pool
        self._journal = open_journal(str(folder), configuration, map_prior, "", resume=True)
        self._events = EventJournal(self._journal, {SNAPSHOT: lambda _: self.snapshots.pass_by(self.session)})
        history = configuration.history if snapshots else HistoryConfiguration()
        self.snapshots = Snapshots(self._journal, history, self.pool)
        self.session = Session(configuration, map_prior, "")
        self.frames = FrameCount()
        self.beliefs: dict[int, HybridBelief] = {}
        self.num_replayed = 0  # events of the journal
        self.snapshots_s = 0.0  # CPU time that they took
        self._events.listen(topics.ODOMETRY, partial(self._use, topics.ODOMETRY, self._add_odometry))
        self._events.listen(topics.MEASUREMENTS, partial(self._use, topics.MEASUREMENTS, self._add_measurements))
        self._pool_of_run = JournaledPool(self.pool, self._journal)
        self._recover()

    def _recover(self) -> None:
        self.snapshots.restore(self, self.session, self._pool_of_run)
        for event in self._events.past():
            self._events.happen_again(event)
            self.num_replayed += 1

    def receive(self, event: Event) -> None:
        """Record and handle a message, and take a snapshot if one is due."""
        self._events.happen(*event)
        begin = time.process_time()
        self.snapshots.take(self, self.session)
        self.snapshots_s += time.process_time() - begin

    def close(self) -> None:
        """End, as a killed process does: its files are closed as they are."""
        assert isinstance(self._journal, Journal)
        self._journal.close()

    def _use(self, topic: str, add: Callable[[Any], None], data: bytes) -> None:
        add(deserialize(data, topics.TYPES[topic]))
        for keyframe, belief in self.session.beliefs(self._pool_of_run):
            self.beliefs[keyframe.index] = belief
            self.snapshots.count()

    def _add_odometry(self, message: Any) -> None:
        self.session.assembler.add_odometry(message)

    def _add_measurements(self, message: Any) -> None:
        measured = self.frames.measured(from_message(message))
        if measured is not None:
            self.session.assembler.add_measurements(measured)


def events_of(keyframes: Iterable[Keyframe]) -> Iterator[Event]:
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
