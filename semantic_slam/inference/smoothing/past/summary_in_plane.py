"""Coordinates in which a summary of the past is Gaussian, in the plane: objects in the frame of a robot pose."""

from collections.abc import Sequence

import gtsam
import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.states.keys import is_robot, is_vector
from semantic_slam.inference.states.spaces import Spaces


def coordinates(spaces: Spaces, keys: Sequence[int], values: gtsam.Values) -> tuple[Array, Array, list[int]]:
    """(m,) coordinates of variables, their (m, m) Jacobian by tangent vectors at ``values``, and which are angles.

    A planar robot pose keeps its own coordinates; objects are expressed in its frame.
    """
    sizes = values.extract(list(keys)).dims()
    ends = np.cumsum([sizes[key] for key in keys]).tolist()
    parts = {key: slice(end - sizes[key], end) for key, end in zip(keys, ends, strict=True)}
    found, slopes = np.zeros(ends[-1]), np.eye(ends[-1])
    for key, part in parts.items():
        state = values.atVector(key) if is_vector(key) else spaces.of(key).state(values, key)
        found[part] = state
        if _turns(spaces, key):
            slopes[part, part][:2, :2] = _rotation(state[2])
    robot = next((key for key in keys if is_robot(key) and _turns(spaces, key)), None)
    if robot is not None:
        for key, part in parts.items():
            if not is_vector(key) and key != robot:
                _see(found, slopes, parts[robot], part)
    turns = [part.start + 2 for key, part in parts.items() if _turns(spaces, key)]
    return found, slopes, turns


def _turns(spaces: Spaces, key: int) -> bool:
    """Whether a variable is a pose (has a heading)."""
    return not is_vector(key) and spaces.of(key).heading is not None


def _see(found: Array, slopes: Array, robot: slice, part: slice) -> None:
    """Transform an object's map coordinates, and their Jacobian, into the robot's frame, in place."""
    back = _rotation(found[robot][2]).T
    found[part.start : part.start + 2] = seen = back @ (found[part][:2] - found[robot][:2])
    slopes[part, part][:2] = back @ slopes[part, part][:2]
    slopes[part, robot][:2] = [[-1.0, 0.0, seen[1]], [0.0, -1.0, -seen[0]]]
    if part.stop - part.start > 2:
        found[part.start + 2] -= found[robot][2]
        slopes[part, robot][2, 2] = -1.0


def _rotation(angle_rad: float) -> Array:
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[cos, -sin], [sin, cos]])
