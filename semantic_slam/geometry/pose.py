"""Poses as arrays: 3-D pose vectors for messages and files, planar poses for the engine.

A pose vector is (..., 7): x y z [m] qx qy qz qw. A planar pose is (..., 3): x y [m] yaw [rad].
A 3-D covariance is (..., 6, 6) over x y z rx ry rz, in the order of geometry_msgs/PoseWithCovariance.
"""

import numpy as np

from semantic_slam.geometry import so3
from semantic_slam.geometry.arrays import Array

PLANAR_AXES = (0, 1, 5)
"""Rows of a 3-D covariance (x, y, rz) that a planar engine fills."""
PLANAR_ENTRIES = np.array([6 * row + column for row in PLANAR_AXES for column in PLANAR_AXES])
"""Flat row-major indices of the x, y, yaw block among the 36 entries of a pose covariance."""


def wrap_angle(angle: Array) -> Array:
    """Angle in [-pi, pi), element-wise."""
    angle = np.asarray(angle, dtype=np.float64)
    turns = np.floor((angle + np.pi) / (2.0 * np.pi))  # many times faster than ``np.mod``
    return np.asarray(angle - 2.0 * np.pi * turns)


def pose_vector_from_planar(planar: Array, height_m: float = 0.0) -> Array:
    """(..., 3) planar pose to (..., 7) pose vector at a constant height."""
    planar = np.asarray(planar, dtype=np.float64)
    vector = np.zeros((*planar.shape[:-1], 7))
    vector[..., :2] = planar[..., :2]
    vector[..., 2] = height_m
    vector[..., 5] = np.sin(planar[..., 2] / 2.0)
    vector[..., 6] = np.cos(planar[..., 2] / 2.0)
    return vector


def planar_from_pose_vector(vector: Array) -> Array:
    """(..., 7) pose vector to (..., 3): its x, y and yaw (rotation about z, REP-103)."""
    vector = np.asarray(vector, dtype=np.float64)
    qx, qy, qz, qw = (vector[..., axis] for axis in range(3, 7))
    planar = np.empty((*vector.shape[:-1], 3))
    planar[..., :2] = vector[..., :2]
    planar[..., 2] = np.arctan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz))
    return planar


def covariance_from_planar(planar: Array) -> Array:
    """(..., 3, 3) over x, y, yaw to (..., 6, 6); the axes that are not estimated are zero."""
    planar = np.asarray(planar, dtype=np.float64)
    covariance = np.zeros((*planar.shape[:-2], 6, 6))
    covariance.reshape(*planar.shape[:-2], 36)[..., PLANAR_ENTRIES] = planar.reshape(*planar.shape[:-2], 9)
    return covariance


def planar_from_covariance(covariance: Array) -> Array:
    """(..., 6, 6) to its (..., 3, 3) block over x, y, yaw."""
    axes = list(PLANAR_AXES)
    return np.asarray(np.asarray(covariance, dtype=np.float64)[..., axes, :][..., axes])


def rotation_matrix(quaternion: Array) -> Array:
    """(4,) quaternion qx qy qz qw of any length to (3, 3) rotation matrix."""
    return so3.matrix(np.asarray(quaternion, dtype=np.float64) / np.linalg.norm(quaternion))


def rotated_by_matrix(rotation: Array, vectors: Array) -> Array:
    """(..., 3) vectors turned by a (3, 3) rotation, each bit-identical whatever vectors are beside it.

    Sums are taken term by term: BLAS rounds a row of a product by the number of rows and its own kernels.
    """
    x, y, z = vectors[..., 0, None], vectors[..., 1, None], vectors[..., 2, None]
    return np.asarray(x * rotation[:, 0] + y * rotation[:, 1] + z * rotation[:, 2])


def transform_points(T_a_b: Array, points_b: Array) -> Array:
    """(N, 3) points in frame b to frame a, by the (7,) pose vector ``T_a_b``."""
    return np.asarray(rotated_by_matrix(rotation_matrix(T_a_b[3:]), points_b) + T_a_b[:3])
