"""SO(3), vectorised: unit quaternions (..., 4) as qx qy qz qw; rotation vectors (..., 3) in radians.

Perturbations act on the right: q = mean * Exp(w). Closed forms as in Sola et al., "A micro Lie theory", 2018. The half
angle is the arctangent of the quaternion's vector and scalar parts, which avoids cancellation near 0 and near pi.
"""

import numpy as np

from semantic_slam.geometry.arrays import Array, squared_norms

SMALL_SQUARE = 2.5e-3
"""Squared angle [rad^2] below which terms use their series; the truncation error is below rounding."""
NO_ZERO = 1e-200
"""Added to an angle used as divisor; it changes only an angle of 0, whose quotients then equal their limits."""
NEXT, LAST = np.array([1, 2, 0]), np.array([2, 0, 1])
"""Cyclic successors and predecessors of the coordinates x, y, z."""


def cross(a: Array, b: Array) -> Array:
    """(..., 3) cross products; many times faster than ``np.cross`` for small batches."""
    return np.asarray(a.take(NEXT, -1) * b.take(LAST, -1) - a.take(LAST, -1) * b.take(NEXT, -1))


def hat(vector: Array) -> Array:
    """(..., 3, 3) skew-symmetric matrices with hat(v) w = v x w."""
    matrix = np.zeros((*vector.shape, 3))
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    matrix[..., 0, 1], matrix[..., 0, 2], matrix[..., 1, 2] = -z, y, -x
    matrix[..., 1, 0], matrix[..., 2, 0], matrix[..., 2, 1] = z, -y, x
    return matrix


def product(p: Array, q: Array) -> Array:
    """Hamilton product: rotate by q first, then by p."""
    found = np.empty(np.broadcast(p, q).shape)
    a, b, c, d = p[..., 0], p[..., 1], p[..., 2], p[..., 3]
    x, y, z, w = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    found[..., 0] = d * x + a * w + b * z - c * y
    found[..., 1] = d * y - a * z + b * w + c * x
    found[..., 2] = d * z + a * y - b * x + c * w
    found[..., 3] = d * w - a * x - b * y - c * z
    return found


def inverse(q: Array) -> Array:
    """Inverse rotation: the conjugate quaternion."""
    return np.asarray(q * np.array([-1.0, -1.0, -1.0, 1.0]))


def normalised(q: Array) -> Array:
    """Quaternions normalised to unit length, with the sign for which qw >= 0."""
    return np.asarray(q / (np.sqrt(squared_norms(q)) * np.where(q[..., 3] < 0.0, -1.0, 1.0))[..., None])


def matrix(q: Array) -> Array:
    """(..., 3, 3) rotation matrices of unit quaternions."""
    x, y, z, w = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    xx, yy, zz, xy, xz, yz, xw, yw, zw = x * x, y * y, z * z, x * y, x * z, y * z, x * w, y * w, z * w
    found = np.empty((*q.shape[:-1], 3, 3))
    found[..., 0, 0] = 1.0 - 2.0 * (yy + zz)
    found[..., 1, 1] = 1.0 - 2.0 * (xx + zz)
    found[..., 2, 2] = 1.0 - 2.0 * (xx + yy)
    found[..., 0, 1], found[..., 1, 0] = 2.0 * (xy - zw), 2.0 * (xy + zw)
    found[..., 0, 2], found[..., 2, 0] = 2.0 * (xz + yw), 2.0 * (xz - yw)
    found[..., 1, 2], found[..., 2, 1] = 2.0 * (yz - xw), 2.0 * (yz + xw)
    return found


def from_matrix(rotation: Array) -> Array:
    """(..., 4) quaternions of rotation matrices, each computed from its largest component (Shepperd, 1978)."""
    r = rotation
    diagonal = r[..., 0, 0], r[..., 1, 1], r[..., 2, 2]
    trace = diagonal[0] + diagonal[1] + diagonal[2]
    squares = np.empty((*r.shape[:-2], 4, 4))  # 4 q q^T
    squares[..., 3, 3] = 1.0 + trace
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        squares[..., i, i] = 1.0 + 2.0 * diagonal[i] - trace
        squares[..., i, j] = squares[..., j, i] = r[..., i, j] + r[..., j, i]
        squares[..., i, 3] = squares[..., 3, i] = r[..., k, j] - r[..., j, k]
    largest = np.argmax(np.einsum("...ii->...i", squares), axis=-1)
    return normalised(np.take_along_axis(squares, largest[..., None, None], axis=-2)[..., 0, :])


def rotated(q: Array, vector: Array) -> Array:
    """(..., 3) vectors rotated by unit quaternions."""
    axis = q[..., :3]
    twice = 2.0 * cross(axis, vector)
    return np.asarray(vector + q[..., 3:] * twice + cross(axis, twice))


def upright(up: Array) -> Array:
    """(4,) attitude of a body that sees "up" in direction (3,): roll and pitch, with zero yaw."""
    x, y, z = up
    roll, pitch = np.arctan2(y, z), np.arctan2(-x, np.hypot(y, z))
    about_y, about_x = exp(np.array([[0.0, pitch, 0.0], [roll, 0.0, 0.0]]))
    return normalised(product(about_y, about_x))


def exp(vector: Array) -> Array:
    """Exponential map: (..., 4) unit quaternions of rotation vectors."""
    half = 0.5 * np.sqrt(squared_norms(vector)) + NO_ZERO
    found = np.empty((*vector.shape[:-1], 4))
    found[..., :3] = (0.5 * np.sin(half) / half)[..., None] * vector
    found[..., 3] = np.cos(half)
    return found


def log(q: Array) -> Array:
    """Logarithm map: (..., 3) rotation vectors of unit quaternions, of length at most pi."""
    sine = np.sqrt(squared_norms(q[..., :3])) + NO_ZERO
    sign = np.where(q[..., 3] < 0.0, -1.0, 1.0)
    return np.asarray((2.0 * sign * np.arctan2(sine, sign * q[..., 3]) / sine)[..., None] * q[..., :3])


def turn_terms(square: Array) -> tuple[Array, Array]:
    """(1 - cos t) / t^2 and (t - sin t) / t^3, from the squares of the angles t."""
    angle = np.sqrt(square) + NO_ZERO
    half = 0.5 * angle
    first = 0.5 * (np.sin(half) / half) ** 2
    series = 1.0 / 6.0 - square / 120.0 + square**2 / 5040.0
    is_small = square < SMALL_SQUARE
    second = np.where(is_small, series, (angle - np.sin(angle)) / np.where(is_small, 1.0, angle * square))
    return first, second


def left_jacobian(vector: Array) -> Array:
    """(..., 3, 3) left Jacobian J with Exp(w + e) = Exp(J e) Exp(w) to first order in e."""
    square = squared_norms(vector)
    return series(turn_terms(square), hat(vector), squared_hat(vector, square))


def series(factors: tuple[Array, Array], turning: Array, squared: Array) -> Array:
    """(..., 3, 3) the sum I + a W + b W W, by ``factors`` a and b (...,), W = ``turning``, and W W = ``squared``."""
    found = factors[0][..., None, None] * turning + factors[1][..., None, None] * squared
    found[..., 0, 0] += 1.0
    found[..., 1, 1] += 1.0
    found[..., 2, 2] += 1.0
    return np.asarray(found)


def right_jacobian(vector: Array) -> Array:
    """(..., 3, 3) right Jacobian J with Exp(w + e) = Exp(w) Exp(J e) to first order in e."""
    return left_jacobian(-vector)


def squared_hat(vector: Array, square: Array) -> Array:
    """(..., 3, 3) hat(v) hat(v), given ``square`` (...,), the squared length of v."""
    found = vector[..., :, None] * vector[..., None, :]
    found[..., 0, 0] -= square
    found[..., 1, 1] -= square
    found[..., 2, 2] -= square
    return np.asarray(found)
