"""Class colours in the live view: an assigned colour is kept."""

import numpy as np

from semantic_slam.inference.belief import HybridBelief
from semantic_slam.report.drawing.palette import CLASS_COLOURS, OTHER_COLOUR, class_colours
from semantic_slam.report.shown.objects import EXISTS


class ClassPalette:
    """Gives the colours there are to the classes that objects were first found to be, where there are more classes.

    Objects that hardly exist get none: they would use up the colours.
    """

    def __init__(self) -> None:
        self._names: tuple[str, ...] = ()
        self._coloured: list[int] = []

    def of(self, belief: HybridBelief) -> list[str]:
        """(C,) colours."""
        count = len(belief.class_names)
        if count <= len(CLASS_COLOURS):
            return class_colours(count)
        if belief.class_names != self._names:
            self._names, self._coloured = belief.class_names, []
        there = belief.class_probabilities[~(belief.existence < EXISTS)]
        for number in np.argmax(there, axis=1).tolist() if len(there) else ():
            if number not in self._coloured and len(self._coloured) < len(CLASS_COLOURS):
                self._coloured.append(number)
        colour_of = dict(zip(self._coloured, CLASS_COLOURS, strict=False))
        return [colour_of.get(number, OTHER_COLOUR) for number in range(count)]
