"""Chain rule in the plane: Jacobians by poses, from Jacobians by a point in a frame that moves with them.

Right perturbations of robot x and object o give, S rotating by a quarter turn, for the object in the body frame d and
the camera in the object's frame v: dd/dx = [-I, -S d], dd/do = [R_x^T R_o, 0], dv/dx = R_o^T R_x [I, S s], dv/do = [-I,
-S v].
"""

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.se2 import sine_cosine
from semantic_slam.inference.models.repeated_rows import repeated


def by_pose(by_point: Array, point: Array) -> Array:
    """(..., m, 3) derivatives by the pose of the frame that ``point`` (..., 2) is given in: by_point [-I, -S point]."""
    derivative = np.empty((*by_point.shape[:-1], 3))
    np.negative(by_point, out=derivative[..., :2])
    derivative[..., 2] = by_point[..., 0] * point[..., None, 1] - by_point[..., 1] * point[..., None, 0]
    return derivative


def by_position(by_point: Array, sin: Array, cos: Array) -> Array:
    """(..., m, 3) derivatives by a pose of which only the position matters, rotated against the frame."""
    sin, cos = sin[..., None], cos[..., None]
    derivative = np.empty((*by_point.shape[:-1], 3))
    derivative[..., 0] = by_point[..., 0] * cos + by_point[..., 1] * sin
    derivative[..., 1] = by_point[..., 1] * cos - by_point[..., 0] * sin
    derivative[..., 2] = 0.0
    return derivative


def by_camera(by_point: Array, angle: Array, sensor: Array) -> Array:
    """(B, m, 3) derivatives by the robot's pose, its camera at ``sensor``: by_point R [I, S s]."""
    derivative = by_position(by_point, *sine_cosine(angle))
    if sensor.any():
        derivative[..., 2] = _about_camera(derivative, repeated(sensor, len(derivative)))
    return derivative


def _about_camera(by_camera: Array, sensor: Array) -> Array:
    """(B, m) derivatives by the heading of a robot whose camera is at ``sensor``: by_point R S s."""
    return np.asarray(by_camera[..., 1] * sensor[..., :1] - by_camera[..., 0] * sensor[..., 1:])
