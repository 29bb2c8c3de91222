"""Second moments, along the axes of map, of poses that err along arcs.

A robot whose heading is uncertain is somewhere along an arc, which the tangent space at its pose makes a straight line:
after driving 10 m with a heading known to 0.4 rad, a Gaussian there is rightly as wide as it is long, while the one of
the linearised position excludes one position in seven where it should exclude one in twenty. See Long, Wolfe, Mashner
and Chirikjian, "The banana distribution is Gaussian", 2012.

The part of a shift that goes with the rotation (its regression on it) is bent by it, as Exp does; the rest of the
shift, such as that of a start whose heading nobody knows, is not. Moments are about the pose, which is the most likely
one and not their mean. Over the rotation they are summed by Gauss-Hermite quadrature: to 1 % for headings known to 3
rad, and in space to 2 % for attitudes known to 0.3 rad about every axis.
"""

import numpy as np

from semantic_slam.geometry import se2, se3, so3
from semantic_slam.geometry.arrays import Array


def _quadrature(nodes: int) -> tuple[Array, Array]:
    """(N,) points and weights for the mean of a function of a standard normal number."""
    points, weights = np.polynomial.hermite_e.hermegauss(nodes)
    return points, weights / weights.sum()


_POINTS, _WEIGHTS = _quadrature(21)
_FEW, _FEW_WEIGHTS = _quadrature(3)
_GRID = np.stack(np.meshgrid(_FEW, _FEW, _POINTS, indexing="ij"), axis=-1).reshape(-1, 3)
_GRID_WEIGHTS = np.einsum("i,j,k->ijk", _FEW_WEIGHTS, _FEW_WEIGHTS, _WEIGHTS).reshape(-1)


def planar(pose: Array, covariance: Array) -> Array:
    """(..., 3, 3) second moments over x, y, yaw, of poses (..., 3) and covariances (..., 3, 3) in the tangent space."""
    turns = np.sqrt(np.maximum(covariance[..., 2, 2], 0.0))[..., None, None] * _POINTS[:, None]  # (..., N, 1)
    moments = covariance[..., [2, 0, 1], :][..., [2, 0, 1]]
    shift = _swept(turns, moments)
    a, b = se2.sine_terms(turns[..., 0])
    bent = np.stack([a * shift[..., 0] - b * shift[..., 1], b * shift[..., 0] + a * shift[..., 1]], axis=-1)
    moments = _moments(turns, shift, bent, _WEIGHTS, moments)
    return se2.rotate_covariance(pose, moments[..., [1, 2, 0], :][..., [1, 2, 0]])


def spatial(pose: Array, covariance: Array) -> Array:
    """(..., 6, 6) second moments, x y z rx ry rz, of poses (..., 7) with (..., 6, 6) in their tangent spaces."""
    values, vectors = np.linalg.eigh(covariance[..., se3.ROTATION, se3.ROTATION])  # ascending: most nodes last
    root = vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :]
    turns = np.einsum("...ij,nj->...ni", root, _GRID)
    shift = _swept(turns, covariance)
    first, second = so3.turn_terms(np.vecdot(turns, turns))
    aside = so3.cross(turns, shift)
    bent = shift + first[..., None] * aside + second[..., None] * so3.cross(turns, aside)
    return se3.covariance_along_parent(pose, _moments(turns, shift, bent, _GRID_WEIGHTS, covariance))


def _swept(turns: Array, covariance: Array) -> Array:
    """(..., N, p) shifts that go with rotations (..., N, r), given the (..., r + p, r + p) covariance of both."""
    size = turns.shape[-1]
    gain = covariance[..., size:, :size] @ np.linalg.pinv(covariance[..., :size, :size], hermitian=True)
    return np.asarray(turns @ np.swapaxes(gain, -1, -2))


def _moments(turns: Array, shift: Array, bent: Array, weights: Array, covariance: Array) -> Array:
    """(..., r + p, r + p) moments where the shifts (..., N, p) of rotations (..., N, r) are ``bent`` (..., N, p)."""
    size = turns.shape[-1]
    straight = np.einsum("n,...ni,...nj->...ij", weights, shift, shift)
    found = covariance.copy()
    found[..., size:, size:] += np.einsum("n,...ni,...nj->...ij", weights, bent, bent) - straight
    found[..., size:, :size] = np.einsum("n,...ni,...nj->...ij", weights, bent, turns)
    found[..., :size, size:] = np.swapaxes(found[..., size:, :size], -1, -2)
    return found
