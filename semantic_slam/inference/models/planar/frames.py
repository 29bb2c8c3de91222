"""Relative positions in the plane: objects in the robot's frame, and its camera in the objects' frames."""

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.se2 import sine_cosine


def object_in_body(x: Array, o: Array) -> Array:
    """(..., 2) positions of objects in the body frame."""
    sin, cos = sine_cosine(x[..., 2])
    return _turned_back(sin, cos, o[..., 0] - x[..., 0], o[..., 1] - x[..., 1])


def camera_in_object(x: Array, o: Array, sensor: Array) -> Array:
    """(B, 2) positions of the camera in the objects' frames; ``sensor`` (2,) or (B, 2) in the body frame."""
    sin, cos = sine_cosine(o[..., 2])
    return _turned_back(sin, cos, *_from_object(x, o, sensor))


def camera_bearing(robot: Array, objects: Array, sensor: Array) -> Array:
    """(K,) directions in map from (K, 2) or (K, 3) objects to the cameras of (K, 3) robots."""
    ahead, left = _from_object(robot, objects, sensor)
    return np.asarray(np.arctan2(left, ahead))


def camera_distance(robot: Array, objects: Array, sensor: Array) -> Array:
    """(K,) distances [m] in the plane from (K, 2) or (K, 3) objects to the cameras of (K, 3) robots."""
    return np.asarray(np.hypot(*_from_object(robot, objects, sensor)))


def _from_object(x: Array, o: Array, sensor: Array) -> tuple[Array, Array]:
    """(B,) offsets of the cameras from the objects along the two axes of map."""
    ahead, left = x[..., 0] - o[..., 0], x[..., 1] - o[..., 1]
    if sensor.any():
        sin, cos = sine_cosine(x[..., 2])
        ahead = ahead + cos * sensor[..., 0] - sin * sensor[..., 1]
        left = left + sin * sensor[..., 0] + cos * sensor[..., 1]
    return ahead, left


def _turned_back(sin: Array, cos: Array, x: Array, y: Array) -> Array:
    turned = np.empty((*np.shape(x), 2))
    turned[..., 0] = cos * x + sin * y
    turned[..., 1] = cos * y - sin * x
    return turned
