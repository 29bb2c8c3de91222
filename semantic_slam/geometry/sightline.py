"""Points in message form: range in the plane [m], bearing and elevation (positive down) [rad], in the body frame.

Lines of sight are kept at least :data:`LEAST_OFF_VERTICAL_RAD` away from the vertical, so that a bearing is defined.
"""

import numpy as np

from semantic_slam.geometry.arrays import Array

LEAST_OFF_VERTICAL_RAD = 1e-4
"""Smallest angle [rad] between a line of sight and the vertical: 0.1 mm per metre."""
LEAST_DISTANCE_M = 1e-6
"""Distance [m] to the body below which a point has no direction."""
STEEPEST_RAD = 0.5 * np.pi - LEAST_OFF_VERTICAL_RAD


def place_of_point(point: Array) -> Array:
    """(..., 3) range in the plane, bearing and elevation (positive downwards) of (..., 3) points."""
    flat = np.hypot(point[..., 0], point[..., 1])
    down = np.clip(np.arctan2(-point[..., 2], flat), -STEEPEST_RAD, STEEPEST_RAD)
    bearing = np.arctan2(point[..., 1], point[..., 0])
    return np.stack([np.hypot(flat, point[..., 2]) * np.cos(down), bearing, down], axis=-1)


def in_plane(point: Array, covariance: Array) -> Array:
    """(2, 2) covariance of in-plane range and bearing of a point (3,), from its (3, 3) body-frame covariance."""
    reach, bearing = place_of_point(point)[:2]
    cosine, sine = np.cos(bearing), np.sin(bearing)
    slopes = np.array([[cosine, sine], [-sine / reach, cosine / reach]])
    spread = slopes @ covariance[:2, :2] @ slopes.T
    return np.asarray(0.5 * (spread + spread.T))


def point_of_place(place: Array) -> tuple[Array, Array]:
    """(..., 3) points for in-plane range, bearing and elevation, and their (..., 3, 3) Jacobians by these."""
    reach, bearing = place[..., 0], place[..., 1]
    down = np.clip(place[..., 2], -STEEPEST_RAD, STEEPEST_RAD)
    cosine, sine, steep = np.cos(bearing), np.sin(bearing), np.tan(down)
    slopes = np.zeros((*place.shape, 3))
    slopes[..., 0, 0], slopes[..., 1, 0], slopes[..., 2, 0] = cosine, sine, -steep
    slopes[..., 0, 1], slopes[..., 1, 1] = -reach * sine, reach * cosine
    slopes[..., 2, 2] = -reach / np.cos(down) ** 2
    return reach[..., None] * slopes[..., 0], slopes
