"""What a camera's image covers in space: its edges, and how far a depth image sees in each direction.

Behind the surfaces of a depth image nothing is detected.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index

GRID = NUM_ROWS, NUM_COLUMNS = 16, 24
"""Cells of the grid, which are even in the tangents of both angles off the optical axis."""
WIDEST_RAD = 1.55
"""Largest angle of an edge off the optical axis: images span less than half a turn."""


@dataclass(frozen=True)
class ImageSight:
    """Edges of an image as angles off the optical axis, and free ranges of R x C directions within them."""

    edges_rad: Array  # (2, 2) [left, right] in the plane of x and z, [top, bottom] in that of y and z
    free_ranges_m: Array  # (R, C) distance of the farthest surface of each cell; NaN: not known; no cells without depth

    @classmethod
    def told(cls, edges_rad: Array, free_ranges_m: Array) -> Self | None:
        """The sight in a message, free ranges NaN where unknown; None where the edges are not those of an image."""
        if not (np.abs(edges_rad) <= WIDEST_RAD).all() or (edges_rad[:, 0] >= edges_rad[:, 1]).any():
            return None
        return cls(edges_rad, np.where(free_ranges_m > 0.0, free_ranges_m, np.nan))

    @property
    def sees_depth(self) -> bool:
        """Whether there is a depth image."""
        return self.free_ranges_m.size > 0

    def ranges_at(self, right: Array, down: Array) -> Array:
        """(...,) free ranges [m] in directions with tangents ``right`` and ``down`` (...,); inf where not known."""
        row, inside_rows = cells_of(down, self.edges_rad[1], self.free_ranges_m.shape[0])
        column, inside_columns = cells_of(right, self.edges_rad[0], self.free_ranges_m.shape[1])
        found = self.free_ranges_m[row, column]
        return np.where(inside_rows & inside_columns & np.isfinite(found), found, np.inf)


def cells_of(tangents: Array, edges: Array, count: int) -> tuple[Index, Flags]:
    """(...,) cell along one axis of each of ``tangents`` (...,), and whether it lies within the edges (2,)."""
    low, high = np.tan(edges)
    share = (tangents - low) / (high - low)
    cells = np.clip((np.clip(share, 0.0, 1.0) * count).astype(int), 0, count - 1)
    return cells, np.asarray((share >= 0.0) & (share <= 1.0))
