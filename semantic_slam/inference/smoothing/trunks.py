"""Checkpoints: components kept along lineages, from which other lineages are rebuilt without replaying all of them."""

from collections import Counter, OrderedDict
from collections.abc import Sequence

from semantic_slam.inference.models.step import Step
from semantic_slam.inference.smoothing.component import Component

APART = 10
"""Keyframes between checkpoints along a lineage."""
MOST = 12
"""Largest number of checkpoints, each a copy of a whole drive; the least recently used is dropped."""


class Trunks:
    """Component checkpoints by hypothesis id; nobody updates them in place."""

    def __init__(self, apart: int | None = None) -> None:
        """``apart``: keyframes between checkpoints."""
        self._apart = APART if apart is None else apart
        self._kept: OrderedDict[int, Component] = OrderedDict()

    def is_due(self, num_keyframes: int) -> bool:
        """Whether a component after ``num_keyframes`` keyframes is to be kept."""
        return num_keyframes % self._apart == 0

    @property
    def faults(self) -> Counter[str]:
        """What went wrong with checkpoints, by reason."""
        return Counter()

    def learn(self, step: Step) -> None:
        """Note the next keyframe; checkpoints in memory need nothing of it."""

    def close(self) -> None:
        """Give up whatever is held besides memory: nothing."""

    def keep(self, number: int, component: Component) -> None:
        """Keep a checkpoint, and drop the least recently used one where there are too many."""
        self._kept[number] = component
        self._kept.move_to_end(number)
        if len(self._kept) > MOST:
            self._kept.popitem(last=False)

    def forget(self) -> None:
        """Drop all checkpoints."""
        self._kept.clear()

    def deepest(self, numbers: Sequence[int]) -> tuple[int, Component] | None:
        """The last checkpoint along a lineage of hypothesis ids ``numbers``: its index among them, and component."""
        for at in reversed(range(len(numbers))):
            if numbers[at] in self._kept:
                self._kept.move_to_end(numbers[at])
                return at, self._kept[numbers[at]]
        return None
