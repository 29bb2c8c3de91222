"""A replay whose checkpoints a snapshot can hold, so that a restarted manager replays histories as if it had gone on.

A replay begins at a checkpoint: a component whose iSAM2 was updated keyframe by keyframe, of which no bytes can be
written. Right after a marginalisation, though, an iSAM2 is a new one of all factors at one linearisation point, which
is made again from its bytes to the last bit. And what a history leads to depends on nothing but its component and the
steps that follow. So this replay also keeps, for each checkpoint of the history followed last, the component after the
last marginalisation before it. A snapshot holds those, how far each checkpoint is, and what it weighs. A checkpoint is
made again when a replay is to begin there, from less than a quarter of a horizon before; where nothing was marginalised
yet, from the prior. Replays thus begin where they would have begun, and find what they would have found, to the bit.

A history followed beside that one can be stored, too, where it has just been marginalised itself. Others are not:
whoever follows any waits with a snapshot.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.checkpoints.stored_component import restored, stored
from semantic_slam.inference.revision.replay import Progress, Replay
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.smoothing.past.horizon import oldest_kept
from semantic_slam.inference.states.lineage import Lineage


@dataclass(frozen=True, kw_only=True)
class StoredReplay:
    """What a snapshot holds of a replay: checkpoints and components, by how many keyframes they are after."""

    lineage: Lineage  # up to the newest checkpoint
    log_joints: Array  # (1 + n,) log P(history, Z_1:i) for i = 0 .. n
    expected_births: dict[int, float]  # of the checkpoints
    replicates: dict[int, Array]  # (B,) of the checkpoints
    components: dict[int, bytes]  # right after marginalisations, for each checkpoint the newest one before it


@dataclass(frozen=True, kw_only=True)
class StoredHistory:
    """What a snapshot holds of a history right after a marginalisation."""

    lineage: Lineage
    log_joint: float
    expected_births: float
    replicates: Array  # (B,)
    component: bytes


@dataclass
class StorableReplay(Replay):
    """A replay of which a snapshot can be taken."""

    _summarised: dict[int, Component] = field(default_factory=dict)  # right after marginalisations, by hypothesis id
    _told: dict[int, Progress] = field(default_factory=dict)  # checkpoints whose components are yet to be made again

    @property
    def may_be_stored(self) -> bool:
        """Whether all checkpoints at which a replay may begin are of the history followed last."""
        return all(own.at < self.reach for own in self._beside.values())

    @property
    def first_step(self) -> int:
        """The oldest keyframe that replays may need from now on."""
        known = self._within_reach()
        made = self._made_from(self._path(known[-1]), known[0].at) if known else None
        return min(self.reach, 0 if made is None else made.keyframe + 1) if known else self.reach

    def stored(self) -> StoredReplay | None:
        """What is stored of it; None where no checkpoint is within reach. Raises TypeError where it cannot be."""
        known = self._within_reach()
        if not known:
            return None
        path = self._path(known[-1])
        components = [self._made_from(path, own.at) for own in known]
        return StoredReplay(
            lineage=known[-1].lineage[: known[-1].at],
            log_joints=np.array(known[-1].log_joints),
            expected_births={own.at: own.expected_births for own in known},
            replicates={own.at: own.replicates for own in known},
            components={made.keyframe + 1: stored(made) for made in components if made is not None},
        )

    def restore(self, told: StoredReplay | None) -> None:
        """Go on from what was stored; the stamps of all keyframes are known by then. Raises ValueError."""
        self.forget()
        if told is None:
            return
        numbers, begun = self._numbers(told.lineage), self.begun(told.lineage)
        for at, data in told.components.items():
            self._summarised[numbers[at]] = restored(data, begun.component)
        log_joints = tuple(told.log_joints.tolist())
        for at, births in told.expected_births.items():
            self._told[numbers[at]] = replace(
                begun,
                at=at,
                number=numbers[at],
                log_joints=log_joints[: at + 1],
                expected_births=births,
                replicates=told.replicates[at],
            )

    @property
    def is_summarised(self) -> bool:
        """Whether histories that have come to the newest keyframe have just been marginalised."""
        return oldest_kept(self.problem.history, len(self.steps) - 1) is not None

    def stored_history(self, own: Progress) -> StoredHistory:
        """What is stored of a history that has just been marginalised. Raises TypeError where it cannot be."""
        return StoredHistory(
            lineage=own.lineage,
            log_joint=own.log_joint,
            expected_births=own.expected_births,
            replicates=own.replicates,
            component=stored(own.component),
        )

    def restored_history(self, told: StoredHistory) -> Progress:
        """The history that was stored; what it weighed earlier is not known any more (NaN). Raises ValueError."""
        at, begun = len(told.lineage), self.begun(told.lineage)
        return Progress(
            lineage=told.lineage,
            at=at,
            number=self.number_of(told.lineage),
            component=restored(told.component, begun.component),
            log_joints=(*([np.nan] * at), told.log_joint),
            expected_births=told.expected_births,
            replicates=told.replicates,
        )

    def forget(self) -> None:
        """Drop all checkpoints, and those of a snapshot."""
        super().forget()
        self._summarised.clear()
        self._told.clear()

    def keep_along(self, lineage: Lineage) -> None:
        """Keep the checkpoints along ``lineage`` alone, and the components from which these can be made again."""
        super().keep_along(lineage)
        numbers = self._numbers(lineage)
        along = set(numbers)
        self._told = {number: own for number, own in self._told.items() if self._stays(own, along)}
        needed = [self._made_from(numbers, own.at) for own in (*self._kept.values(), *self._told.values())]
        self._summarised = {n: own for n, own in self._summarised.items() if any(own is other for other in needed)}

    def resumed(self, lineage: Lineage) -> Progress:
        """A history at the latest checkpoint along it, which is made again where only a snapshot has it."""
        known = self._kept.keys() | self._beside.keys() | self._told.keys()
        deepest = next((number for number in reversed(self._numbers(lineage)) if number in known), None)
        if deepest in self._told:
            self._kept[deepest] = self._made(self._told.pop(deepest))
        return super().resumed(lineage)

    def _made(self, told: Progress) -> Progress:
        """A checkpoint of a snapshot, with its component."""
        path = self._path(told)
        made = self._made_from(path, told.at)
        own = self.begun(told.lineage)
        if made is not None:
            own = replace(own, at=made.keyframe + 1, number=path[made.keyframe + 1], component=made)
        while own.at < told.at:
            own = self._stepped(own)
        return replace(told, component=own.component)

    def _stepped(self, own: Progress) -> Progress:
        own = super()._stepped(own)
        if oldest_kept(self.problem.history, own.at - 1) is not None:
            self._summarised[own.number] = own.component
        return own

    def _is_kept(self, own: Progress) -> bool:
        return super()._is_kept(own) or own.number in self._summarised

    def _within_reach(self) -> list[Progress]:
        """The checkpoints of the history followed last at which a replay may begin, the newest last."""
        every = [own for own in (*self._kept.values(), *self._told.values()) if own.at >= self.reach]
        return sorted(every, key=lambda own: own.at)

    def _path(self, own: Progress) -> list[int]:
        """Ids of the hypotheses along a history, the root's first, up to where it has come."""
        return self._numbers(own.lineage[: own.at])

    def _made_from(self, numbers: Sequence[int], at: int) -> Component | None:
        """The component after the last marginalisation within ``at`` keyframes of a history; None: there was none."""
        places = [(own.keyframe + 1, number) for number, own in self._summarised.items()]
        along = [(place, number) for place, number in places if place <= at and numbers[place] == number]
        return self._summarised[max(along)[1]] if along else None
