"""Rigid transforms in space as (7,) pose vectors: composition, inverse, interpolation."""

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import rotation_matrix
from semantic_slam.geometry.so3 import cross

NEARLY_PARALLEL = 1.0 - 1e-9
"""Cosine between quaternions above which linear interpolation replaces the arc (slerp)."""


def compose(T_a_b: Array, T_b_c: Array) -> Array:
    """Composed transform T_a_c, with p_a = T_a_b @ (T_b_c @ p_c)."""
    position = T_a_b[:3] + rotation_matrix(T_a_b[3:]) @ T_b_c[:3]
    return np.concatenate([position, quaternion_product(T_a_b[3:], T_b_c[3:])])


def inverse(T_a_b: Array) -> Array:
    """Inverse transform T_b_a of T_a_b."""
    conjugate = T_a_b[3:] * np.array([-1.0, -1.0, -1.0, 1.0]) / np.linalg.norm(T_a_b[3:])
    return np.concatenate([-rotation_matrix(conjugate) @ T_a_b[:3], conjugate])


def between(T_a_b: Array, T_a_c: Array) -> Array:
    """Relative transform T_b_c: the second pose as seen from the first."""
    return compose(inverse(T_a_b), T_a_c)


def interpolate(first: Array, second: Array, share: float) -> Array:
    """Interpolated pose at ``share`` (0..1) of the way: position linear, rotation along the shorter arc."""
    a, b = first[3:] / np.linalg.norm(first[3:]), second[3:] / np.linalg.norm(second[3:])
    cosine = float(a @ b)
    if cosine < 0.0:
        b, cosine = -b, -cosine
    if cosine > NEARLY_PARALLEL:
        quaternion = (1.0 - share) * a + share * b
    else:
        angle = np.arccos(cosine)
        quaternion = (np.sin((1.0 - share) * angle) * a + np.sin(share * angle) * b) / np.sin(angle)
    position = (1.0 - share) * first[:3] + share * second[:3]
    return np.concatenate([position, quaternion / np.linalg.norm(quaternion)])


def rotation_angle(T_a_b: Array) -> float:
    """Angle of the rotation, 0..pi."""
    return float(2.0 * np.arctan2(np.linalg.norm(T_a_b[3:6]), abs(T_a_b[6])))


def quaternion_product(p: Array, q: Array) -> Array:
    """(4,) Hamilton product of quaternions qx qy qz qw: first rotate by q, then by p."""
    vector = p[3] * q[:3] + q[3] * p[:3] + cross(p[:3], q[:3])
    return np.append(vector, p[3] * q[3] - p[:3] @ q[:3])
