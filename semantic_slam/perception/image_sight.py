"""What a camera's image covers in space: its edges, and how far a depth image sees in each direction.

Behind the surfaces of a depth image nothing is detected.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.perception.boxes.box_sizes import pixel_rays
from semantic_slam.perception.frame import CameraModel

GRID = NUM_ROWS, NUM_COLUMNS = 16, 24
"""Cells of the grid, which are even in the tangents of both angles off the optical axis."""
READINGS = 4
"""Depth readings of a cell along each axis."""
LEAST_VALID = 0.5
"""Smallest share of valid readings of a usable cell: out-of-range cannot be told from unreadable depth."""
WIDEST_RAD = 1.55
"""Largest angle of an edge off the optical axis: images span less than half a turn."""


@dataclass(frozen=True)
class ImageSight:
    """Edges of an image as angles off the optical axis, and free ranges of R x C directions within them."""

    edges_rad: Array  # (2, 2) [left, right] in the plane of x and z, [top, bottom] in that of y and z
    free_ranges_m: Array  # (R, C) distance of the farthest surface of each cell; NaN: not known; no cells without depth

    @classmethod
    def of(cls, camera: CameraModel, depth_m: NDArray[np.float32] | None = None, boxes: Array | None = None) -> Self:
        """The sight of a camera with a depth image, whose readings inside (D, 4) ``boxes`` [px] are left out.

        These are of detected objects, which are no surfaces that hide themselves.
        """
        edges = edges_of(camera)
        if depth_m is None:
            return cls(edges, np.zeros((0, 0)))
        return cls(edges, _free_ranges(depth_m, camera, edges, np.zeros((0, 4)) if boxes is None else boxes))

    @classmethod
    def told(cls, edges_rad: Array, free_ranges_m: Array) -> Self | None:
        """As a message has it, NaN where nothing is known; None where the edges are not those of an image."""
        if not (np.abs(edges_rad) <= WIDEST_RAD).all() or (edges_rad[:, 0] >= edges_rad[:, 1]).any():
            return None
        return cls(edges_rad, np.where(free_ranges_m > 0.0, free_ranges_m, np.nan))

    @property
    def sees_depth(self) -> bool:
        """Whether there is a depth image."""
        return self.free_ranges_m.size > 0

    def ranges_at(self, right: Array, down: Array) -> Array:
        """(...,) free ranges [m] in directions with tangents ``right`` and ``down`` (...,); inf where not known."""
        row, inside_rows = _cells(down, self.edges_rad[1], self.free_ranges_m.shape[0])
        column, inside_columns = _cells(right, self.edges_rad[0], self.free_ranges_m.shape[1])
        found = self.free_ranges_m[row, column]
        return np.where(inside_rows & inside_columns & np.isfinite(found), found, np.inf)


def edges_of(camera: CameraModel) -> Array:
    """(2, 2) angles [rad] of the image's edges off the optical axis, lens distortion removed."""
    width, height = float(camera.width), float(camera.height)
    middles = np.array([[0.0, camera.cy], [width, camera.cy], [camera.cx, 0.0], [camera.cx, height]])
    x, y, z = pixel_rays(middles, camera).T
    angles = np.array(
        [[np.arctan2(x[0], z[0]), np.arctan2(x[1], z[1])], [np.arctan2(y[2], z[2]), np.arctan2(y[3], z[3])]]
    )
    return np.asarray(np.clip(angles, -WIDEST_RAD, WIDEST_RAD))


def _free_ranges(depth_m: NDArray[np.float32], camera: CameraModel, edges: Array, boxes: Array) -> Array:
    """(R, C) distance of the farthest reading of each cell; NaN where fewer than half of its readings are valid."""
    rows, columns = _spread(depth_m.shape[0], NUM_ROWS * READINGS), _spread(depth_m.shape[1], NUM_COLUMNS * READINGS)
    u, v = (grid.ravel() for grid in np.meshgrid(columns, rows))
    depths = depth_m[v, u].astype(np.float64)
    rays = pixel_rays(np.stack([u, v], axis=1).astype(np.float64) + 0.5, camera)
    row, is_in_rows = _cells(rays[:, 1] / rays[:, 2], edges[1], NUM_ROWS)
    column, is_in_columns = _cells(rays[:, 0] / rays[:, 2], edges[0], NUM_COLUMNS)
    valid = np.isfinite(depths) & (depths > 0.0) & is_in_rows & is_in_columns
    for low_x, low_y, high_x, high_y in boxes.tolist():
        valid &= ~((u >= low_x) & (u <= high_x) & (v >= low_y) & (v <= high_y))
    farthest, counts, total = (np.zeros((NUM_ROWS, NUM_COLUMNS)) for _ in range(3))
    np.maximum.at(farthest, (row[valid], column[valid]), depths[valid] / rays[valid, 2])
    np.add.at(counts, (row[valid], column[valid]), 1.0)
    np.add.at(total, (row, column), 1.0)
    return np.where(counts >= LEAST_VALID * np.maximum(total, 1.0), farthest, np.nan)


def _cells(tangents: Array, edges: Array, count: int) -> tuple[Index, Flags]:
    """(...,) cell along one axis of each of ``tangents`` (...,), and whether it lies within the edges (2,)."""
    low, high = np.tan(edges)
    share = (tangents - low) / (high - low)
    cells = np.clip((np.clip(share, 0.0, 1.0) * count).astype(int), 0, count - 1)
    return cells, np.asarray((share >= 0.0) & (share <= 1.0))


def _spread(length: int, count: int) -> Index:
    """(count,) pixel indices at the centres of equal parts of ``length``."""
    return ((np.arange(count) + 0.5) * length / count).astype(int)
