"""Free-range scan: how far a depth image sees per direction; objects beyond could not have been detected."""

import cv2
import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.pose import transform_points
from semantic_slam.perception.frame import CameraModel

NUM_STRIPS, COLUMNS_OF_STRIP, NUM_ROWS = 48, 3, 40
"""Number of strips of image columns, and the columns and rows of depth readings sampled in each."""
LEAST_VALID = 0.5
"""Smallest share of valid readings of a usable strip: out-of-range cannot be told from unreadable depth."""


def farthest_free_ranges(depth_m: NDArray[np.float32], camera: CameraModel, T_base_camera: Array) -> Array:
    """(B, 2) bearing [rad] and range [m] of each strip's farthest surface, from the body origin in its x-y plane.

    The farthest one, because object heights are unknown: a surface lower than the object does not occlude it.
    """
    height, width = depth_m.shape
    rows = _spread(height, NUM_ROWS)
    columns = _spread(width, NUM_STRIPS * COLUMNS_OF_STRIP)
    readings = depth_m[rows[:, None], columns].astype(np.float64)
    valid = np.isfinite(readings) & (readings > 0.0)
    depths = np.where(valid, readings, 0.0).reshape(-1, 1)
    points = transform_points(T_base_camera, _rays(columns, rows, camera) * depths)
    distance = np.where(valid, np.hypot(points[:, 0], points[:, 1]).reshape(readings.shape), -np.inf)
    bearing = np.arctan2(points[:, 1], points[:, 0]).reshape(readings.shape)
    distances, bearings = _by_strip(distance), _by_strip(bearing)
    strips = np.flatnonzero(np.isfinite(distances).mean(axis=1) >= LEAST_VALID)
    farthest = distances[strips].argmax(axis=1)
    return np.column_stack([bearings[strips, farthest], distances[strips, farthest]])


def _by_strip(readings: Array) -> Array:
    """Regroup (rows, columns) readings to (strips, readings of each)."""
    return np.moveaxis(readings.reshape(NUM_ROWS, NUM_STRIPS, COLUMNS_OF_STRIP), 1, 0).reshape(NUM_STRIPS, -1)


def _spread(length: int, count: int) -> Index:
    """(count,) pixel indices at the centres of equal parts of ``length``."""
    return ((np.arange(count) + 0.5) * length / count).astype(int)


def _rays(columns: Index, rows: Index, camera: CameraModel) -> Array:
    """(rows x columns, 3) points at a depth of one metre, in the optical frame, lens distortion removed."""
    u, v = np.meshgrid(columns.astype(np.float64), rows.astype(np.float64))
    intrinsics = np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])
    distortion = np.array(camera.distortion or (0.0, 0.0, 0.0, 0.0))
    pixels = np.stack([u.ravel(), v.ravel()], axis=-1)[:, None]
    plane = cv2.undistortPoints(pixels, intrinsics, distortion).reshape(-1, 2)
    return np.column_stack([plane, np.ones(len(plane))])
