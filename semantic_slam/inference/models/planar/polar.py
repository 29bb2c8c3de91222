"""Distance and direction of points in the plane."""

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.states.spaces import LEAST_DISTANCE_M


def polar(point: Array) -> tuple[Array, Array]:
    """Distance [m] and direction [rad] of (..., 2) points."""
    x, y = point[..., 0], point[..., 1]
    return np.maximum(np.sqrt(x * x + y * y), LEAST_DISTANCE_M), np.arctan2(y, x)


def polar_jacobian(point: Array, distance: Array) -> tuple[Array, Array]:
    """(..., 2) derivatives of distance and of direction with respect to the point."""
    scale = 1.0 / distance
    radial, turn = np.empty_like(point), np.empty_like(point)
    radial[..., 0], radial[..., 1] = point[..., 0] * scale, point[..., 1] * scale
    turn[..., 0], turn[..., 1] = -radial[..., 1] * scale, radial[..., 0] * scale
    return radial, turn


def from_polar(distance: Array, direction: Array) -> tuple[Array, Array]:
    """(..., 2) points at distances and directions (...,), and their (..., 2, 2) Jacobians by these."""
    slopes = np.empty((*distance.shape, 2, 2))
    slopes[..., 0, 0], slopes[..., 1, 0] = np.cos(direction), np.sin(direction)
    points = distance[..., None] * slopes[..., 0]
    slopes[..., 0, 1], slopes[..., 1, 1] = -points[..., 1], points[..., 0]
    return points, slopes
