"""Background replay: proposed histories are replayed a few keyframes at a time until they reach the newest keyframe.

Through keyframes that such a history does not name, such as those that arrive meanwhile, its likeliest continuations
are followed side by side; it ends as the likeliest of these.
"""

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.revision.replay import Progress, Replay, Revised
from semantic_slam.inference.smoothing.errors import LostComponentError
from semantic_slam.inference.states.lineage import Lineage

STEPS_PER_KEYFRAME = 25
"""Keyframes replayed per new keyframe, over all waiting histories: a fraction of a second of CPU."""


BRANCHES = 4
"""Continuations of one history that are followed side by side."""
HOPELESS = 40.0
"""Nats behind the history that it revises at which a replay is given up."""
BROKEN_PROMISE = 20.0
"""Nats behind that history, and behind what later keyframes promise on top, at which a replay is given up. In four
simulated walks, no history that was likelier in the end had been behind by more than 14."""


class Level(NamedTuple):
    """A history that has reached the newest keyframe, or was given up."""

    asked: Lineage  # as it was proposed
    own: Revised | None  # through all keyframes so far; None: impossible, or hopeless


class _Replayed(NamedTuple):
    """A history that waits to be replayed further."""

    asked: Lineage  # as it was proposed
    front: list[Progress]  # its continuations, likeliest first; none before it begins
    least: Array  # (k + 1,) log P(history, Z_1:i) below which it is given up; (0,): it never is


class CatchingUp:
    """A queue of histories waiting to be replayed, first in first out."""

    def __init__(self, replay: Replay) -> None:
        self._replay = replay
        self._waiting: deque[_Replayed] = deque()

    @property
    def is_idle(self) -> bool:
        """Whether the queue is empty."""
        return not self._waiting

    def add(self, lineages: Iterable[Lineage], against: Sequence[float] = (), gains: Array | None = None) -> None:
        """Append histories to the queue.

        ``against``: log P(history, Z_1:i) of the history that they revise, for i = 0 .. k; () if there is none.
        ``gains``: (k,) what each keyframe promises over it [nats], where that is known.
        """
        least = np.array(against) - HOPELESS if gains is None else np.array(against) - _left(gains) - BROKEN_PROMISE
        self._waiting.extend(_Replayed(lineage, [], least) for lineage in lineages)

    def give_up(self) -> None:
        """Empty the queue."""
        self._waiting.clear()

    def go_on(self, count: int = STEPS_PER_KEYFRAME) -> Iterator[Level]:
        """Histories that reach the newest keyframe within ``count`` more replayed keyframes, also ones added since."""
        now = len(self._replay.steps)
        while self._waiting and count > 0:
            asked, front, least = self._waiting.popleft()
            try:
                front = front or [self._replay.resumed(asked)]
                while front[0].at < now and count > 0:
                    count -= len(front)
                    front = self._next(asked, front)
                    _check_hope(front[0], least)
            except LostComponentError:
                yield Level(asked, None)
                continue
            if front[0].at == now:
                yield Level(asked, self._replay.finished(front[0]))
            else:
                self._waiting.appendleft(_Replayed(asked, front, least))

    def _next(self, asked: Lineage, front: Sequence[Progress]) -> list[Progress]:
        """The continuations after one more keyframe. Raises LostComponentError where there is none."""
        if front[0].at < len(asked):
            return [self._replay.further(front[0])]
        return self._replay.branched(front, BRANCHES)


def _left(gains: Array) -> Array:
    """(k + 1,) sum of the ``gains`` (k,) of all keyframes after the first i."""
    return np.append(np.cumsum(gains[::-1])[::-1], 0.0)


def _check_hope(best: Progress, least: Array) -> None:
    """Raises LostComponentError where a history is too far behind the one that it revises."""
    if best.at < len(least) and best.log_joint < least[best.at]:
        raise LostComponentError("a revised history is far less likely than the one that it revises")
