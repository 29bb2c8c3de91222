"""The keyframes of a run that a backend may have to replay: all, or those since its oldest checkpoint."""

from array import array
from collections import deque

from semantic_slam.inference.models.step import Step


class KeptSteps:
    """Steps by keyframe, and the stamps of all: those are in the names of hypotheses."""

    def __init__(self) -> None:
        self.stamps_ns = array("q")
        self._kept: deque[Step] = deque()

    def __len__(self) -> int:
        """Keyframes so far, with those that are forgotten."""
        return len(self.stamps_ns)

    @property
    def first(self) -> int:
        """The oldest keyframe that is kept; the next one where none is."""
        return len(self) - len(self._kept)

    def append(self, step: Step) -> None:
        """The next keyframe."""
        self.stamps_ns.append(step.stamp_ns)
        self._kept.append(step)

    def __getitem__(self, keyframe: int) -> Step:
        if keyframe < self.first:
            raise IndexError(f"keyframe {keyframe} is forgotten; the oldest that is kept is {self.first}")
        return self._kept[keyframe - self.first]

    def forget_before(self, keyframe: int) -> None:
        """Keep the steps from a keyframe on."""
        while self._kept and self.first < keyframe:
            self._kept.popleft()
