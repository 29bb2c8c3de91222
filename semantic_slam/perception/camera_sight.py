"""What a camera covers in space: the edges of its image by the intrinsics, and free ranges by a depth image."""

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.perception.boxes.box_sizes import pixel_rays
from semantic_slam.perception.frame import CameraModel
from semantic_slam.perception.image_sight import NUM_COLUMNS, NUM_ROWS, WIDEST_RAD, ImageSight, cells_of

READINGS = 4
"""Depth readings of a cell along each axis."""
LEAST_VALID = 0.5
"""Smallest share of valid readings of a usable cell: out-of-range cannot be told from unreadable depth."""


def sight_of(camera: CameraModel, depth_m: NDArray[np.float32] | None = None, boxes: Array | None = None) -> ImageSight:
    """The sight of a camera with a depth image, whose readings inside (D, 4) ``boxes`` [px] are left out.

    These are of detected objects, which are no surfaces that hide themselves.
    """
    edges = edges_of(camera)
    if depth_m is None:
        return ImageSight(edges, np.zeros((0, 0)))
    return ImageSight(edges, _free_ranges(depth_m, camera, edges, np.zeros((0, 4)) if boxes is None else boxes))


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
    row, is_in_rows = cells_of(rays[:, 1] / rays[:, 2], edges[1], NUM_ROWS)
    column, is_in_columns = cells_of(rays[:, 0] / rays[:, 2], edges[0], NUM_COLUMNS)
    valid = np.isfinite(depths) & (depths > 0.0) & is_in_rows & is_in_columns
    for low_x, low_y, high_x, high_y in boxes.tolist():
        valid &= ~((u >= low_x) & (u <= high_x) & (v >= low_y) & (v <= high_y))
    farthest, counts, total = (np.zeros((NUM_ROWS, NUM_COLUMNS)) for _ in range(3))
    np.maximum.at(farthest, (row[valid], column[valid]), depths[valid] / rays[valid, 2])
    np.add.at(counts, (row[valid], column[valid]), 1.0)
    np.add.at(total, (row, column), 1.0)
    return np.where(counts >= LEAST_VALID * np.maximum(total, 1.0), farthest, np.nan)


def _spread(length: int, count: int) -> Index:
    """(count,) pixel indices at the centres of equal parts of ``length``."""
    return ((np.arange(count) + 0.5) * length / count).astype(int)
