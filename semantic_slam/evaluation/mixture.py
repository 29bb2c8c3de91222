"""Errors and consistency of a Gaussian mixture over poses.

Poses are (..., 7) vectors in map. Errors and covariances are x y z rx ry rz along the axes of map, as in
geometry_msgs/PoseWithCovariance: rotations act on the left of the mean.
"""

from collections.abc import Sequence
from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.chi_squared import chi_squared_quantile
from semantic_slam.geometry.moments import position_moments

NUM_CIRCLES, NUM_ANGLES = 200, 16
"""Numbers of circles and angles of the sample points that represent a planar Gaussian."""


def pose_error(pose: Array, reference: Array) -> Array:
    """(H, 6) difference ``pose`` - ``reference``: positions [m] and rotation vectors [rad] in map; (H, 7) and (7,)."""
    turn = Rotation.from_quat(pose[:, 3:]) * Rotation.from_quat(reference[3:]).inv()
    return np.hstack([pose[:, :3] - reference[:3], turn.as_rotvec()])


def normalised_error_squared(error: Array, covariance: Array) -> float:
    """NEES e^T P^-1 e of (d,) and (d, d): d on average when the belief is consistent; NaN when P is singular."""
    try:
        return float(error @ np.linalg.solve(covariance, error))
    except np.linalg.LinAlgError:
        return float("nan")


def log_density(log_weights: Array, means: Array, covariances: Array, pose: Array, axes: Sequence[int]) -> float:
    """Log density of ``pose`` (7,) under the mixture, over the ``axes`` of x y z rx ry rz [nats; m and rad].

    ``log_weights`` (H,), ``means`` (H, 7), ``covariances`` (H, 6, 6); NaN when a covariance is singular.
    """
    chosen = np.asarray(axes, dtype=int)
    errors = -pose_error(means, pose)[:, chosen]
    spread = covariances[:, chosen[:, None], chosen]
    sign, log_determinant = np.linalg.slogdet(2.0 * np.pi * spread)
    if (sign <= 0.0).any():
        return float("nan")
    squared = np.einsum("hi,hi->h", errors, np.linalg.solve(spread, errors[..., None])[..., 0])
    return float(np.logaddexp.reduce(log_weights - 0.5 * (log_determinant + squared)))


def position_region(
    weights: Array, positions: Array, covariances: Array, truth: Array, probability: float = 0.95
) -> tuple[bool, float]:
    """Whether a mixture's planar credible region contains the truth (2,), and the radius [m] of a circle of equal area.

    The region is an ellipse with the mixture's mean and the shape of its covariance, scaled to contain ``probability``
    of the mixture itself; the moment-matched Gaussian's ellipse would contain less of a heavy-tailed mixture.
    ``weights`` (H,) sum to one; ``positions`` (H, 2), ``covariances`` (H, 2, 2).
    """
    mean, covariance = position_moments(weights, positions, covariances)
    points = positions[:, None] + _normals() @ np.swapaxes(np.linalg.cholesky(covariances), 1, 2)
    inverse = np.linalg.inv(covariance)
    squared = np.einsum("hni,ij,hnj->hn", points - mean, inverse, points - mean)
    limit = _quantile(squared, weights / squared.shape[1], probability)
    inside = float((truth - mean) @ inverse @ (truth - mean)) <= limit
    return inside, float(np.sqrt(limit * np.sqrt(np.linalg.det(covariance))))


@cache
def _normals() -> Array:
    """(N, 2) equally weighted sample points of a standard normal, on circles at equal steps of probability."""
    radii = np.sqrt(chi_squared_quantile((np.arange(NUM_CIRCLES) + 0.5) / NUM_CIRCLES, 2))
    angles = 2.0 * np.pi * np.arange(NUM_ANGLES) / NUM_ANGLES
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return np.asarray((radii[:, None, None] * circle).reshape(-1, 2))


def _quantile(values: Array, weights: Array, probability: float) -> float:
    """Weighted quantile of (H, N) values; each value of row h has weight ``weights[h]``."""
    order = np.argsort(values, axis=None)
    each = np.broadcast_to(weights[:, None], values.shape).ravel()[order]
    return float(np.interp(probability, np.cumsum(each) - 0.5 * each, values.ravel()[order]))


def position_determinant(weights: Array, covariances: Array) -> float:
    """Determinant [m^4] of the x-y block of the heaviest component's covariance (H, d, d)."""
    return float(np.linalg.det(covariances[np.argmax(weights)][:2, :2]))


def heaviest_position_error(weights: Array, positions: Array, reference: Array) -> float:
    """Distance [m] in the plane of the heaviest component from ``reference``; (H, >= 2) and (>= 2,)."""
    return float(np.linalg.norm(positions[np.argmax(weights), :2] - reference[:2]))


def weighted_position_error(weights: Array, positions: Array, reference: Array) -> float:
    """Weighted mean distance [m] in the plane of the components from ``reference``: not the error of the mean."""
    return float(weights @ np.linalg.norm(positions[:, :2] - reference[:2], axis=1))
