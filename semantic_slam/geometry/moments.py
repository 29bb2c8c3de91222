"""Moment matching: mean and covariance of Gaussian mixtures over poses."""

import numpy as np

from semantic_slam.geometry.arrays import Array

SINGULAR = 1e-14
"""Eigenvalues below this fraction of the largest one count as zero."""


def position_sigmas(covariances: Array) -> Array:
    """(O,) largest standard deviations of positions [m], from (O, d, d) whose first two rows are those of x and y."""
    xx, yy, xy = covariances[:, 0, 0], covariances[:, 1, 1], covariances[:, 0, 1]
    largest = 0.5 * (xx + yy) + np.sqrt(0.25 * (xx - yy) ** 2 + xy**2)
    return np.asarray(np.sqrt(np.maximum(largest, 0.0)))


def largest_sigmas(covariances: Array) -> Array:
    """(O,) largest standard deviations in any direction, from (O, p, p) of two or three coordinates."""
    if covariances.shape[-1] == 2:
        return position_sigmas(covariances)
    return np.asarray(np.sqrt(np.maximum(np.linalg.eigvalsh(covariances)[..., -1], 0.0)))


def largest_sigma_m(covariance: Array, axes: int) -> float:
    """Standard deviation [m] of a position along the direction in which it is largest, NaN where it is not known.

    ``covariance`` is (n, n) with x, y, z first, of which the first ``axes`` are estimated.
    """
    place = covariance[:axes, :axes]
    return float(largest_sigmas(place[None])[0]) if np.isfinite(place).all() else float("nan")


def position_moments(weights: Array, positions: Array, covariances: Array) -> tuple[Array, Array]:
    """(d,) mean and (d, d) covariance of a mixture of Gaussians over positions.

    ``weights`` (H,) sum to one; ``positions`` (H, d), ``covariances`` (H, d, d).
    """
    mean = weights @ positions
    offsets = positions - mean
    return mean, np.einsum("h,hij->ij", weights, covariances + offsets[:, :, None] * offsets[:, None, :])


def matched_moments(weights: Array, poses: Array, covariances: Array) -> tuple[Array, Array]:
    """(7,) pose and (6, 6) covariance of the Gaussian with the moments of the mixture.

    ``poses`` (H, 7) and ``covariances`` (H, 6, 6; x y z rx ry rz along fixed axes) are those of the components.
    Components without the pose (NaN) are left out and the weights renormalised; with none left the result is NaN.
    """
    mean, covariance = matched_moments_of_many(weights, poses[:, None], covariances[:, None])
    return mean[0], covariance[0]


def matched_moments_of_many(weights: Array, poses: Array, covariances: Array) -> tuple[Array, Array]:
    """:func:`matched_moments` of O mixtures at once: ``poses`` (H, O, 7), ``covariances`` (H, O, 6, 6) -> (O, ...)."""
    if len(poses) == 1:
        return poses[0].copy(), covariances[0].copy()
    count = poses.shape[1]
    present = np.isfinite(poses).all(-1) & (weights > 0.0)[:, None]  # (H, O)
    number = present.sum(axis=0)
    means, spreads = np.full((count, 7), np.nan), np.full((count, 6, 6), np.nan)
    alone = np.flatnonzero(number == 1)
    row = np.argmax(present[:, alone], axis=0)
    means[alone], spreads[alone] = poses[row, alone], covariances[row, alone]
    several = np.flatnonzero(number > 1)
    if len(several):
        shares = np.where(present, weights[:, None], 0.0)[:, several]
        shares /= shares.sum(axis=0)
        own = np.where(present[:, several, None], poses[:, several], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
        inner = np.where(present[:, several, None, None], covariances[:, several], 0.0)
        means[several], spreads[several] = _matched(shares, own, inner)
    return means, spreads


def _matched(shares: Array, poses: Array, covariances: Array) -> tuple[Array, Array]:
    """Moments of (H, O, 7) poses with (H, O, 6, 6) covariances, for (H, O) weights that sum to one over H."""
    from scipy.spatial.transform import Rotation  # deferred: the import takes 0.2 s, and most processes do not need it

    position = np.einsum("ho,hoi->oi", shares, poses[..., :3])
    scatter = np.einsum("ho,hoi,hoj->oij", shares, poses[..., 3:], poses[..., 3:])
    mean = Rotation.from_quat(np.linalg.eigh(scatter)[1][..., -1])  # the mean rotation of Markley et al., 2007
    hypotheses, count = shares.shape
    repeated = Rotation.from_quat(np.tile(mean.inv().as_quat(), (hypotheses, 1)))
    turned = Rotation.from_quat(poses[..., 3:].reshape(-1, 4)) * repeated
    deviation = np.concatenate([poses[..., :3] - position, turned.as_rotvec().reshape(hypotheses, count, 3)], axis=-1)
    spread = np.einsum("ho,hoi,hoj->oij", shares, deviation, deviation)
    covariance = np.einsum("ho,hoij->oij", shares, covariances) + spread
    return np.concatenate([position, mean.as_quat(canonical=True)], axis=-1), covariance


def transport(before: Array, after: Array) -> Array:
    """(d, d) optimal transport map C between Gaussians: C ``before`` C^T = ``after``, symmetric and nearest to I.

    After Olkin and Pukelsheim, 1982. Where ``before`` is singular, restricted to its support.
    """
    root = _power(after, 0.5)
    return np.asarray(root @ _power(root @ before @ root, -0.5) @ root)


def _power(square: Array, exponent: float) -> Array:
    """Power of a symmetric matrix on its support (eigenvalues that are not zero)."""
    values, vectors = np.linalg.eigh(0.5 * (square + square.T))
    kept = values > SINGULAR * max(float(values.max(initial=0.0)), 1e-300)
    return np.asarray((vectors[:, kept] * values[kept] ** exponent) @ vectors[:, kept].T)
