"""The frame map of a body in space: its start at the origin, heading along x, gravity down."""

import numpy as np

from semantic_slam.geometry import se3, so3
from semantic_slam.geometry.arrays import Array

OPTICAL = np.array([0.0, 0.0, 0.0, -0.5, 0.5, -0.5, 0.5])
"""(7,) T_body_camera of a body that is the camera, its axes those of REP-103: x ahead, y left, z up in the picture."""


def level_start(up: Array) -> Array:
    """(7,) pose in map of a body at its origin that sees the (3,) direction up; it rolls and pitches without a yaw."""
    return np.concatenate([np.zeros(3), so3.upright(up)])


def map_of_start(start: Array, up: Array) -> Array:
    """(7,) T_map_world from the pose (7,) of the body at its start and the (3,) direction up, both in some world."""
    seen = so3.rotated(so3.inverse(start[3:]), up)
    return se3.compose(level_start(seen), se3.inverse(start))
