"""SE(3), vectorised: poses (..., 7) as x y z [m] qx qy qz qw; tangent vectors (..., 6) in GTSAM's Pose3 order.

That order is [rotation, translation]: three radians, then three metres. Perturbations act on the right:
x = mean * Exp(e). Covariances in messages have the translation first (:func:`covariance_along_parent`). Closed forms
as in Barfoot, "State Estimation for Robotics", 2017, Sec. 7.1, with the products of hat matrices expanded.
"""

import numpy as np

from semantic_slam.geometry import so3
from semantic_slam.geometry.arrays import Array, squared_norms

ROTATION, TRANSLATION = slice(0, 3), slice(3, 6)
"""Rows of tangent vectors."""
NEARLY = 2e-3
"""Tolerance of a quaternion's squared norm about 1 (three hand-typed digits); :func:`wrapped` normalises it."""
TO_MESSAGE = np.array([3, 4, 5, 0, 1, 2])
"""Permutation of tangent-vector rows to message order; it is its own inverse."""


def compose(a: Array, b: Array) -> Array:
    """Composition T_a b: transforms pose b from the frame of a into the parent frame of a."""
    return _joined(a[..., :3] + so3.rotated(a[..., 3:], b[..., :3]), so3.product(a[..., 3:], b[..., 3:]))


def frame(pose: Array) -> Array:
    """(..., 16) precomputed frames: pose and row-major rotation matrix, for :func:`placed`."""
    found = np.empty((*pose.shape[:-1], 16))
    found[..., :7] = pose
    found[..., 7:] = so3.matrix(pose[..., 3:]).reshape(*pose.shape[:-1], 9)
    return found


def placed(frames: Array, b: Array) -> Array:
    """Composition T_a b from the :func:`frame` of a."""
    rotation = frames[..., 7:].reshape(*frames.shape[:-1], 3, 3)
    moved = (rotation @ b[..., :3, None])[..., 0]
    return _joined(frames[..., :3] + moved, so3.product(frames[..., 3:7], b[..., 3:]))


def along(start: Array, steps: Array) -> Array:
    """(..., T, 7) poses after each of T consecutive relative motions (..., T, 7) from ``start`` (..., 7)."""
    found = np.empty(np.broadcast_shapes((*start.shape[:-1], 1, 7), steps.shape))
    pose = start
    for number in range(steps.shape[-2]):
        pose = found[..., number, :] = compose(pose, steps[..., number, :])
    return found


def wrapped(pose: Array) -> Array:
    """Poses with their quaternions normalised to unit length and qw >= 0."""
    return np.concatenate([pose[..., :3], so3.normalised(pose[..., 3:])], axis=-1)


def inverse(a: Array) -> Array:
    """Inverse: pose of the parent frame in the frame of a."""
    back = so3.inverse(a[..., 3:])
    return _joined(-so3.rotated(back, a[..., :3]), back)


def between(a: Array, b: Array) -> Array:
    """Relative pose: b in the frame of a."""
    back = so3.inverse(a[..., 3:])
    return _joined(so3.rotated(back, b[..., :3] - a[..., :3]), so3.product(back, b[..., 3:]))


def exp(tangent: Array) -> Array:
    """Exponential map: group element of a tangent vector."""
    turn = tangent[..., ROTATION]
    return _exp(turn, tangent[..., TRANSLATION], so3.turn_terms(squared_norms(turn)))


def exp_and_jacobian(tangent: Array) -> tuple[Array, Array]:
    """:func:`exp`, and the (..., 6, 6) right Jacobian; faster than one after the other."""
    turn, shift = tangent[..., ROTATION], tangent[..., TRANSLATION]
    square = squared_norms(turn)
    terms = so3.turn_terms(square)
    return _exp(turn, shift, terms), _left_jacobian(-turn, -shift, square, terms)


def log(pose: Array) -> Array:
    """Logarithm map: tangent vector of a group element, with a rotation of at most pi."""
    turn, position = so3.log(pose[..., 3:]), pose[..., :3]
    aside = so3.cross(turn, position)
    found = np.empty((*pose.shape[:-1], 6))
    found[..., ROTATION] = turn
    found[..., TRANSLATION] = position - 0.5 * aside + _inverse_term(turn)[..., None] * so3.cross(turn, aside)
    return found


def retract(pose: Array, tangent: Array) -> Array:
    """pose Exp(tangent)."""
    return compose(pose, exp(tangent))


def adjoint(pose: Array) -> Array:
    """(..., 6, 6) adjoint Ad with pose Exp(e) = Exp(Ad e) pose."""
    rotation = so3.matrix(pose[..., 3:])
    return _blocks(rotation, so3.hat(pose[..., :3]) @ rotation)


def inverse_adjoint(pose: Array) -> Array:
    """(..., 6, 6) inverse adjoint Ad^-1 with Exp(e) pose = pose Exp(Ad^-1 e)."""
    back = np.swapaxes(so3.matrix(pose[..., 3:]), -1, -2)
    return _blocks(back, -back @ so3.hat(pose[..., :3]))


def left_jacobian(tangent: Array) -> Array:
    """(..., 6, 6) left Jacobian J with Exp(t + e) = Exp(J e) Exp(t) to first order in e."""
    turn = tangent[..., ROTATION]
    square = squared_norms(turn)
    return _left_jacobian(turn, tangent[..., TRANSLATION], square, so3.turn_terms(square))


def right_jacobian(tangent: Array) -> Array:
    """(..., 6, 6) right Jacobian J with Exp(t + e) = Exp(t) Exp(J e) to first order in e."""
    return left_jacobian(-tangent)


def covariance_along_parent(pose: Array, covariance: Array) -> Array:
    """Convert tangent-space covariance to message form: (..., 6, 6), x y z rx ry rz along the parent's axes."""
    turns = _turns(so3.matrix(pose[..., 3:]))
    return np.asarray((turns @ covariance @ np.swapaxes(turns, -1, -2))[..., TO_MESSAGE, :][..., TO_MESSAGE])


def covariance_at_pose(pose: Array, covariance: Array) -> Array:
    """Convert message-form covariance (along the parent's axes) to (..., 6, 6) over tangent vectors at the pose."""
    turns = _turns(np.swapaxes(so3.matrix(pose[..., 3:]), -1, -2))
    ordered = covariance[..., TO_MESSAGE, :][..., TO_MESSAGE]
    return np.asarray(turns @ ordered @ np.swapaxes(turns, -1, -2))


def mean(poses: Array, weights: Array) -> Array:
    """(..., 7) weighted mean of (P, ..., 7) poses, (P,) normalised weights; rotations after Markley et al., 2007."""
    quaternions = np.moveaxis(poses[..., 3:], 0, -2)  # (..., P, 4)
    scatter = np.swapaxes(quaternions, -1, -2) @ (weights[:, None] * quaternions)
    turn = so3.normalised(np.linalg.eigh(scatter)[1][..., -1])
    return _joined(np.tensordot(weights, poses[..., :3], 1), turn)


def is_pose(vector: Array) -> bool:
    """Whether ``vector`` (7,) is finite with a quaternion of unit length up to rounding (:data:`NEARLY`)."""
    return bool(np.isfinite(vector).all() and abs(squared_norms(vector[3:]) - 1.0) <= NEARLY)


def _exp(turn: Array, shift: Array, terms: tuple[Array, Array]) -> Array:
    """(..., 7) :func:`exp` of both parts of a tangent vector, given :func:`so3.turn_terms`."""
    aside = so3.cross(turn, shift)
    moved = shift + terms[0][..., None] * aside + terms[1][..., None] * so3.cross(turn, aside)
    return _joined(moved, so3.exp(turn))


def _left_jacobian(turn: Array, shift: Array, square: Array, terms: tuple[Array, Array]) -> Array:
    """(..., 6, 6) :func:`left_jacobian`, given the square of the turn and :func:`so3.turn_terms`.

    Its lower left block is Barfoot's Q, simplified by a^ b^ a^ = -(a b) a^.
    """
    turning, squared, inner = so3.hat(turn), so3.squared_hat(turn, square), np.asarray(np.vecdot(turn, shift))
    _, second = terms
    third, fourth = _shift_terms(square)
    outer = turn[..., :, None] * shift[..., None, :]
    lower = _scale(0.5 - square * third) * so3.hat(shift)
    lower += _scale((2.0 * third - second) * inner) * turning
    lower += _scale(second) * (outer + np.swapaxes(outer, -1, -2))
    lower -= _scale(2.0 * inner * fourth) * squared
    lower[..., [0, 1, 2], [0, 1, 2]] -= (2.0 * second * inner)[..., None]
    return _blocks(so3.series(terms, turning, squared), lower)


def _shift_terms(square: Array) -> tuple[Array, Array]:
    """(t^2 + 2 cos t - 2) / 2 t^4 and (2 t - 3 sin t + t cos t) / 2 t^5, from the squares of the angles t."""
    angle, is_small = np.sqrt(square), square < 10.0 * so3.SMALL_SQUARE
    divisor = np.where(is_small, 1.0, square)
    series = 1.0 / 24.0 - square / 720.0 + square**2 / 40320.0 - square**3 / 3628800.0
    first = np.where(is_small, series, (0.5 * square + np.cos(angle) - 1.0) / divisor**2)
    series = 1.0 / 120.0 - square / 2520.0 + square**2 / 120960.0 - square**3 / 9979200.0
    top = 2.0 * angle - 3.0 * np.sin(angle) + angle * np.cos(angle)
    second = np.where(is_small, series, top / np.where(is_small, 1.0, 2.0 * angle * divisor**2))
    return first, second


def _inverse_term(turn: Array) -> Array:
    """(...,) (1 - h / tan h) / t^2 for angles t = 2 h: coefficient of hat(t)^2 in the inverse left Jacobian."""
    square = squared_norms(turn)
    half, is_small = 0.5 * np.sqrt(square) + so3.NO_ZERO, square < so3.SMALL_SQUARE
    series = 1.0 / 12.0 + square / 720.0 + square**2 / 30240.0
    exact = (1.0 - half * np.cos(half) / np.sin(half)) / np.where(is_small, 1.0, square)
    return np.where(is_small, series, exact)


def _blocks(diagonal: Array, lower: Array) -> Array:
    """(..., 6, 6) block matrices [[D, 0], [L, D]]."""
    found = np.zeros((*diagonal.shape[:-2], 6, 6))
    found[..., ROTATION, ROTATION] = found[..., TRANSLATION, TRANSLATION] = diagonal
    found[..., TRANSLATION, ROTATION] = lower
    return found


def _turns(rotation: Array) -> Array:
    """(..., 6, 6) block-diagonal matrices that rotate both parts of tangent vectors by (..., 3, 3)."""
    return _blocks(rotation, np.zeros(rotation.shape))


def _joined(position: Array, quaternion: Array) -> Array:
    found = np.empty((*np.broadcast(position[..., 0], quaternion[..., 0]).shape, 7))
    found[..., :3], found[..., 3:] = position, quaternion
    return found


def _scale(values: Array) -> Array:
    return values[..., None, None]
