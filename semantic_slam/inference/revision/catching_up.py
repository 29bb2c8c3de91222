"""Histories that are replayed beside the keyframes, a few keyframes of theirs in each, until they are level with these.

Through keyframes of which such a history says nothing, as those that come meanwhile, its likeliest continuations go on
side by side; the likeliest one is what becomes of it.
"""

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

from semantic_slam.inference.revision.replay import Lineage, Progress, Replay, Revised
from semantic_slam.inference.smoothing.errors import LostComponentError

STEPS_PER_KEYFRAME = 25
"""Keyframes that are replayed in one, all histories that wait together: a fraction of a second of CPU."""


BRANCHES = 4
"""Continuations that go on side by side."""


class Level(NamedTuple):
    """A history that has caught up, or is impossible."""

    asked: Lineage  # as it was when it began to wait
    own: Revised | None  # through all keyframes so far; None: impossible


class CatchingUp:
    """Histories that wait, the first one first."""

    def __init__(self, replay: Replay) -> None:
        self._replay = replay
        self._waiting: deque[tuple[Lineage, list[Progress]]] = deque()  # none yet: it has not begun

    @property
    def is_idle(self) -> bool:
        """Whether none waits."""
        return not self._waiting

    def add(self, lineages: Iterable[Lineage]) -> None:
        """Let histories wait after those that do already."""
        self._waiting.extend((lineage, []) for lineage in lineages)

    def give_up(self) -> None:
        """Let none wait any longer."""
        self._waiting.clear()

    def go_on(self, count: int = STEPS_PER_KEYFRAME) -> Iterator[Level]:
        """Histories that are level after at most ``count`` keyframes more, also of what is added meanwhile."""
        now = len(self._replay.steps)
        while self._waiting and count > 0:
            asked, front = self._waiting.popleft()
            front = front or [self._replay.resumed(asked)]
            try:
                while front[0].at < now and count > 0:
                    count -= len(front)
                    front = self._next(asked, front)
            except LostComponentError:
                yield Level(asked, None)
                continue
            if front[0].at == now:
                yield Level(asked, self._replay.finished(front[0]))
            else:
                self._waiting.appendleft((asked, front))

    def _next(self, asked: Lineage, front: Sequence[Progress]) -> list[Progress]:
        """One keyframe more. Raises LostComponentError where that is impossible."""
        if front[0].at < len(asked):
            return [self._replay.further(front[0])]
        return self._replay.branched(front, BRANCHES)
