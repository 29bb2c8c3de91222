"""Background replay: proposed histories are replayed a few keyframes at a time until they reach the newest keyframe.

Through keyframes that such a history does not name, such as those that arrive meanwhile, its likeliest continuations
are followed side by side; it ends as the likeliest of these.
"""

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from semantic_slam.inference.revision.replay import Progress, Replay, Revised
from semantic_slam.inference.smoothing.errors import LostComponentError
from semantic_slam.inference.states.lineage import Lineage

STEPS_PER_KEYFRAME = 25
"""Keyframes replayed per new keyframe, over all waiting histories: a fraction of a second of CPU."""


BRANCHES = 4
"""Continuations of one history that are followed side by side."""
HOPELESS = 40.0
"""Nats behind the history that it revises at which a replay is given up, beside the gain that it promises. In two
simulated walks, histories that entered in the end by 15 to 430 nats had been up to 17 and 75 behind on the way."""


class Level(NamedTuple):
    """A history that has reached the newest keyframe, or was given up."""

    asked: Lineage  # as it was proposed
    own: Revised | None  # through all keyframes so far; None: impossible, or hopeless


class _Replayed(NamedTuple):
    """A history that waits to be replayed further."""

    asked: Lineage  # as it was proposed
    front: list[Progress]  # its continuations, likeliest first; none before it begins
    against: Sequence[float]  # log P(history, Z_1:i) of the one that it revises
    hopeless: float  # nats behind that one at which it is given up


class CatchingUp:
    """A queue of histories waiting to be replayed, first in first out."""

    def __init__(self, replay: Replay) -> None:
        self._replay = replay
        self._waiting: deque[_Replayed] = deque()

    @property
    def is_idle(self) -> bool:
        """Whether the queue is empty."""
        return not self._waiting

    def add(self, lineages: Iterable[Lineage], against: Sequence[float] = (), gain: float = 0.0) -> None:
        """Append histories to the queue.

        ``against``: log P(history, Z_1:i) of the history that they revise, for i = 0 .. k; () if there is none.
        ``gain``: what they promise over it [nats].
        """
        self._waiting.extend(_Replayed(lineage, [], against, HOPELESS + gain) for lineage in lineages)

    def give_up(self) -> None:
        """Empty the queue."""
        self._waiting.clear()

    def go_on(self, count: int = STEPS_PER_KEYFRAME) -> Iterator[Level]:
        """Histories that reach the newest keyframe within ``count`` more replayed keyframes, also ones added since."""
        now = len(self._replay.steps)
        while self._waiting and count > 0:
            asked, front, against, hopeless = self._waiting.popleft()
            try:
                front = front or [self._replay.resumed(asked)]
                while front[0].at < now and count > 0:
                    count -= len(front)
                    front = self._next(asked, front)
                    _check_hope(front[0], against, hopeless)
            except LostComponentError:
                yield Level(asked, None)
                continue
            if front[0].at == now:
                yield Level(asked, self._replay.finished(front[0]))
            else:
                self._waiting.appendleft(_Replayed(asked, front, against, hopeless))

    def _next(self, asked: Lineage, front: Sequence[Progress]) -> list[Progress]:
        """The continuations after one more keyframe. Raises LostComponentError where there is none."""
        if front[0].at < len(asked):
            return [self._replay.further(front[0])]
        return self._replay.branched(front, BRANCHES)


def _check_hope(best: Progress, against: Sequence[float], hopeless: float) -> None:
    """Raises LostComponentError where a history is too far behind the one that it revises."""
    if best.at < len(against) and best.log_joint < against[best.at] - hopeless:
        raise LostComponentError("a revised history is far less likely than the one that it revises")
