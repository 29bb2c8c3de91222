"""What tells a network's outputs from another's: how its input is normalised, and how its boxes are coded."""

from collections.abc import Sequence
from typing import ClassVar, Protocol

from semantic_slam.geometry.arrays import Array, Bytes


class Layout(Protocol):
    """Input and outputs of a detector."""

    grey: ClassVar[int]
    """Value of the input's pixels, 0..255, that a letterboxed picture leaves."""

    def normalised(self, pixels: Bytes) -> Array:
        """(H, W, 3) channels of the network's input, from (H, W, 3) RGB pixels."""
        ...

    def boxes(self, outputs: Sequence[Array]) -> tuple[Array, Array]:
        """Decode all (N, 4) boxes, in pixels of the input, and their (N, C) scores, NaN where not reported.

        Where outputs number the classes, scores have one more column, of all numbers that are of none of the C.
        Raises ValueError for numbers that are not of this layout.
        """
        ...
