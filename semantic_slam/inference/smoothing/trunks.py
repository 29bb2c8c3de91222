"""Components kept along histories, from which others that begin alike are rebuilt without replaying all of them."""

from collections import OrderedDict
from collections.abc import Sequence

from semantic_slam.inference.smoothing.component import Component

APART = 10
"""Keyframes from one component that is kept along a history to the next."""
MOST = 12
"""Components kept at most, each a copy of a whole drive: those that were kept or asked for last."""


class Trunks:
    """Components by the id of their hypothesis; nobody updates them in place."""

    def __init__(self, apart: int | None = None) -> None:
        """``apart``: keyframes from one to the next."""
        self._apart = APART if apart is None else apart
        self._kept: OrderedDict[int, Component] = OrderedDict()

    def is_due(self, num_keyframes: int) -> bool:
        """Whether a component after so many keyframes is one to keep."""
        return num_keyframes % self._apart == 0

    @property
    def oldest(self) -> int:
        """Keyframes that the oldest component has behind it, 0 where none is kept."""
        return min((component.keyframe + 1 for component in self._kept.values()), default=0)

    def keep(self, number: int, component: Component) -> None:
        """Keep a component, and forget the one that was asked for longest ago where they are too many."""
        self._kept[number] = component
        self._kept.move_to_end(number)
        if len(self._kept) > MOST:
            self._kept.popitem(last=False)

    def forget(self) -> None:
        """Keep none."""
        self._kept.clear()

    def deepest(self, numbers: Sequence[int]) -> tuple[int, Component] | None:
        """The last of the hypotheses ``numbers`` along a history that is kept: its place among them, and it."""
        for at in reversed(range(len(numbers))):
            if numbers[at] in self._kept:
                self._kept.move_to_end(numbers[at])
                return at, self._kept[numbers[at]]
        return None
