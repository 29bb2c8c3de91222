"""Histories that are replayed beside the keyframes, a few keyframes of theirs in each, until they are level with these.

Keyframes that come meanwhile continue such a history as is likeliest for it.
"""

from collections import deque
from collections.abc import Iterable
from typing import NamedTuple

from semantic_slam.inference.revision.replay import Lineage, Progress, Replay, Revised
from semantic_slam.inference.smoothing.errors import LostComponentError

STEPS_PER_KEYFRAME = 25
"""Keyframes that are replayed in one, all histories that wait together: a fraction of a second of CPU."""


class Level(NamedTuple):
    """A history that has caught up, or is impossible."""

    asked: Lineage  # as it was when it began to wait
    own: Revised | None  # through all keyframes so far; None: impossible


class CatchingUp:
    """Histories that wait, the first one first."""

    def __init__(self, replay: Replay) -> None:
        self._replay = replay
        self._waiting: deque[tuple[Lineage, Progress | None]] = deque()  # None: it has not begun

    @property
    def is_idle(self) -> bool:
        """Whether none waits."""
        return not self._waiting

    def add(self, lineages: Iterable[Lineage]) -> None:
        """Let histories wait after those that do already."""
        self._waiting.extend((lineage, None) for lineage in lineages)

    def give_up(self) -> None:
        """Let none wait any longer."""
        self._waiting.clear()

    def go_on(self, count: int = STEPS_PER_KEYFRAME) -> list[Level]:
        """Histories that are level after at most ``count`` keyframes more of them all."""
        found, now = list[Level](), len(self._replay.steps)
        while self._waiting and count > 0:
            asked, own = self._waiting.popleft()
            own = own or self._replay.resumed(asked)
            try:
                while own.at < now and count > 0:
                    count -= 1
                    own = self._replay.further(own)
            except LostComponentError:
                found.append(Level(asked, None))
                continue
            if own.at == now:
                found.append(Level(asked, self._replay.finished(own)))
            else:
                self._waiting.appendleft((asked, own))
        return found
