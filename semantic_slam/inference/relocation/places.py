"""Candidate poses of a carried robot: histories that catch up, and those that wait for more evidence.

A look starts many, which advance together until they have replayed all keyframes. Those that weigh too little by then
are followed for a while longer, as later detections may decide.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import ClassVar

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.relocation.likelihood_field import differ
from semantic_slam.inference.revision.replay import Progress, Revised
from semantic_slam.inference.revision.storable_replay import StorableReplay, StoredHistory
from semantic_slam.inference.smoothing.errors import LostComponentError
from semantic_slam.inference.states.lineage import Lineage
from semantic_slam.inference.world.carried import FIRST_POINT

AHEAD, HOPELESS = 2, 12.0
"""Keyframes that candidates are replayed at a time, and nats behind the best of them at which one is dropped."""
FORGOTTEN, MOST = 20.0, 16
"""Nats behind the best live hypothesis at which a candidate that caught up is dropped, and how many are kept."""
STEPS_PER_KEYFRAME = 40
"""Keyframes replayed per new keyframe, over all candidates that catch up."""


class Places:
    """Follows the candidate poses of a carried robot."""

    STATE: ClassVar[tuple[str, ...]] = ("_stored",)

    def __init__(self, replay: StorableReplay) -> None:
        self._replay = replay
        self._behind: list[Progress] = []  # of the newest look, all at the same keyframe
        self.through: list[Progress] = []  # caught up, the likeliest first

    @property
    def lineages(self) -> list[Lineage]:
        """Lineages of all candidates that are followed."""
        return [own.lineage for own in (*self._behind, *self.through)]

    @property
    def is_looking(self) -> bool:
        """Whether candidates of the newest look have not caught up yet."""
        return bool(self._behind)

    @property
    def may_be_stored(self) -> bool:
        """Whether all candidates have caught up, and can be stored."""
        return not self._behind and (not self.through or self._replay.is_summarised)

    @property
    def _stored(self) -> list[StoredHistory]:
        return [self._replay.stored_history(own) for own in self.through]

    @_stored.setter
    def _stored(self, told: list[StoredHistory]) -> None:
        self.through = [self._replay.restored_history(own) for own in told]

    def begin(self, before: Progress, points: Iterable[int | None]) -> None:
        """Start candidates at lattice points to which the robot was carried, replacing those not caught up yet."""
        found = [self._carried(before, point) for point in points if point is not None]
        self._behind = [own for own in found if own is not None]

    def go_on(self, log_best: float, log_unplaced: Callable[[int], float]) -> None:
        """Advance after a new keyframe; ``log_best``: log P(history, Z_1:k) of the best live history.

        ``log_unplaced``: log weight of a candidate that recognises nothing, by the number of keyframes.
        """
        caught_up = self._caught_up(log_unplaced)
        on = [own for own in map(self._to_newest, self.through) if own is not None]
        every = sorted([*on, *caught_up], key=lambda own: (-own.log_joint, own.number))
        self.through = _different(own for own in every if own.log_joint > log_best - FORGOTTEN)[:MOST]

    def give_up(self, numbers: Iterable[int]) -> None:
        """Stop following some candidates that have caught up."""
        gone = set(numbers)
        self.through = [own for own in self.through if own.number not in gone]

    def _caught_up(self, log_unplaced: Callable[[int], float]) -> list[Progress]:
        """Candidates of the newest look once they have caught up; unlikely ones are dropped on the way."""
        left, now = STEPS_PER_KEYFRAME, len(self._replay.steps)
        while self._behind and left > 0 and self._behind[0].at < now:
            at = min(self._behind[0].at + AHEAD, now)
            left -= len(self._behind) * (at - self._behind[0].at)
            group = [self._advanced(own, AHEAD) for own in self._behind]
            self._behind = _likely(group, log_unplaced(at))
        if not self._behind or self._behind[0].at < now:
            return []
        through, self._behind = self._behind, []
        return through

    def _carried(self, before: Progress, point: int) -> Progress | None:
        try:
            return self._replay.carried(before, point)
        except LostComponentError:
            return None

    def _to_newest(self, own: Progress) -> Progress | None:
        return self._advanced(own, len(self._replay.steps) - own.at)

    def _advanced(self, own: Progress, count: int) -> Progress | None:
        try:
            return self._replay.advanced(own, count)
        except LostComponentError:
            return None


@dataclass(frozen=True)
class Account:
    """What a history claims: when the robot was carried, what it has seen, and where it is.

    The lattice point it was carried to is left out: neighbouring points lead to one place.
    """

    seen: tuple[tuple[tuple[int, ...], int], ...]  # association, and whether carried before it, per keyframe
    pose: Array  # (3,)

    @classmethod
    def of(cls, lineage: Lineage, pose: Array) -> "Account":
        """The account of a history after which the robot is at ``pose``."""
        return cls(tuple((step.association, min(step.lattice_point, FIRST_POINT)) for step in lineage[1:]), pose)

    def is_like(self, other: "Account") -> bool:
        """Whether two histories are alike in what they saw and in pose: with one object alone many poses fit."""
        return self.seen == other.seen and not differ(self.pose, other.pose)


def account(own: Progress | Revised) -> Account:
    """The account of a history that was replayed."""
    return Account.of(own.lineage, own.component.newest_robot()[:3])


def _different(histories: Iterable[Progress]) -> list[Progress]:
    """Histories that are unlike each other; of two alike the first is kept."""
    kept, accounts = list[Progress](), list[Account]()
    for own in histories:
        said = account(own)
        if not any(map(said.is_like, accounts)):
            kept.append(own)
            accounts.append(said)
    return kept


def _likely(group: Sequence[Progress | None], log_least: float) -> list[Progress]:
    """Histories at one keyframe, without those far behind the best of them or ``log_least``."""
    found = [own for own in group if own is not None]
    best = max([log_least, *(own.log_joint for own in found)])
    return [own for own in found if own.log_joint >= best - HOPELESS]
