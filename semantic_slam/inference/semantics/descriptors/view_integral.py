"""Evidence and posterior of views of one object whose descriptor is hardly known, by points instead of Laplace.

Over what a descriptor may be after a first view, the decoder is far from linear, and the Gaussian at the mode is too
narrow. A better one is found by statistical linearisation (posterior linearisation; Garcia-Fernandez et al., 2015): a
regression of the residuals over points of the Gaussian itself, with what the line leaves added to the noise. The
evidence is a mean of importance weights over points of that Gaussian, which is so near the posterior that some 80 of
them are as exact as a thousand of the Gaussian at the mode. The points are fixed, and each row is computed on its own,
so that a result depends neither on batches nor on processes.
"""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.special import gammaincinv

from semantic_slam.geometry.arrays import Array, Index, diagonals, squared_norms
from semantic_slam.geometry.rows import take
from semantic_slam.inference.models.latent.detection_features import DetectionFeatures
from semantic_slam.inference.models.latent.observation import LatentObservation

KNOWN_SHARE, HARDLY_KNOWN_SHARE = 0.4, 0.6
"""Spread of a descriptor, relative to the prior's, at which the integral begins to count, and counts fully."""
FIRST_PAIRS, MORE_PAIRS = 16, 2
"""Number of antithetic pairs of points of the first linearisation, at least, and beyond the number of dimensions."""
FRAMES, LAST_PAIRS = 3, 32
"""Number of orthonormal frames that direct the points of the evidence, at least, and of their antithetic pairs."""
WIDER = 1.05
"""Factor on the standard deviations of the evidence's points: one linearisation leaves them somewhat too narrow."""
BATCH = 16
"""Number of rows at a time: all points of more do not fit into a processor's cache."""


def share_of_integral(variances: Array, prior_sigma: Array) -> Array:
    """(B,) weight in [0, 1] of the integral against Laplace's, from (B, L) variances of descriptors after the view.

    How far the decoder is from linear depends on the spread over which it is used, and the scale is the prior's: the
    spread of all objects that it describes. Laplace's error falls with the square of the ratio. For the shipped model
    it is 1.4 nats at 0.8, 0.3 at 0.65, 0.15 at 0.5 and 0.07 at a third. The ramp leaves no step.
    """
    spread = np.sqrt((variances / prior_sigma**2).mean(axis=-1))
    return np.asarray(np.clip((spread - KNOWN_SHARE) / (HARDLY_KNOWN_SHARE - KNOWN_SHARE), 0.0, 1.0))


@dataclass(frozen=True, kw_only=True)
class ViewIntegral:
    """B integrals over y ~ N(0, I) of n views each, with (descriptor, azimuth of the first view) = offset + gain y."""

    observation: LatentObservation
    seen: tuple[DetectionFeatures, ...]  # n of B
    turn: Array  # (B, n) azimuth of each view from that of the first
    offset: Array  # (B, L + 1)
    gain: Array  # (B, L + 1, V)

    def at(self, y: Array, hessian: Array) -> tuple[Array, Array, Array]:
        """Log evidence (B,), mean (B, V) and information (B, V, V) of y, from a mode and the Hessian there."""
        evidence, mean, information = np.empty(len(y)), np.empty_like(y), np.empty_like(hessian)
        for first in range(0, len(y), BATCH):
            rows = slice(first, first + BATCH)
            part = self._select(np.arange(len(y))[rows])
            evidence[rows], mean[rows], information[rows] = part._at(y[rows], hessian[rows])
        return evidence, mean, information

    def _select(self, rows: Index) -> "ViewIntegral":
        part = take(self, rows, ("turn", "offset", "gain"))
        return replace(part, seen=tuple(each.take(rows) for each in self.seen))

    def _at(self, y: Array, hessian: Array) -> tuple[Array, Array, Array]:
        """The Gaussian of a first linearisation has the points of the evidence and of a second linearisation.

        They are other points than the first ones, to which that Gaussian is fitted: with the same ones evidence is low.
        """
        first, second = fixed_points(y.shape[1])
        mean, information = self._evaluated(y, hessian, first).posterior()
        evaluated = self._evaluated(mean, information / WIDER**2, second)
        return evaluated.log_evidence(), *evaluated.posterior()

    def _evaluated(self, y: Array, hessian: Array, points: Array) -> "_Evaluated":
        root = np.asarray(np.linalg.cholesky(hessian))
        at = y[:, None] + points @ np.linalg.inv(root)
        residual, log_normaliser = self._residuals(at)
        return _Evaluated(y=y, root=root, points=points, at=at, residual=residual, log_normaliser=log_normaliser)

    def _residuals(self, y: Array) -> tuple[Array, Array]:
        """(B, S, n F) whitened residuals and (B, S) log normalisers at (B, S, V) points."""
        told = self.offset[:, None] + y @ np.swapaxes(self.gain, 1, 2)
        azimuth, e = told[..., -1], told[..., :-1]
        parts = [
            self.observation.residuals(seen, azimuth + turn[:, None], e)
            for seen, turn in zip(self.seen, self.turn.T, strict=True)
        ]
        residuals, log_normalisers = zip(*parts, strict=True)
        return np.concatenate(residuals, axis=2), np.asarray(sum(log_normalisers))


@dataclass(frozen=True, kw_only=True)
class _Evaluated:
    """B views at S points of Gaussians N(y, (root root^T)^-1)."""

    y: Array  # (B, V)
    root: Array  # (B, V, V)
    points: Array  # (S, V) standard normal
    at: Array  # (B, S, V)
    residual: Array  # (B, S, n F) whitened
    log_normaliser: Array  # (B, S)

    def posterior(self) -> tuple[Array, Array]:
        """Mean and information of the Gaussian posterior with the residuals linearised over the Gaussian."""
        centre = self.residual.mean(axis=1)
        slope = np.swapaxes(self.residual, 1, 2) @ self.points / len(self.points)  # (B, n F, V) by the points
        left = self.residual - centre[:, None] - self.points @ np.swapaxes(slope, 1, 2)
        weight = 1.0 / (1.0 + (left**2).mean(axis=1))
        jacobian = slope @ np.swapaxes(self.root, 1, 2)
        weighted = np.swapaxes(jacobian * weight[..., None], 1, 2)
        information = np.eye(self.y.shape[1]) + weighted @ jacobian
        gradient = self.y + (weighted @ centre[..., None])[..., 0]
        return self.y - np.linalg.solve(information, gradient[..., None])[..., 0], information

    def log_evidence(self) -> Array:
        """(B,) log mean of the points' importance weights."""
        squares = squared_norms(self.residual) + squared_norms(self.at) - squared_norms(self.points)
        mean = np.logaddexp.reduce(self.log_normaliser - 0.5 * squares, axis=1) - np.log(len(self.points))
        return np.asarray(mean - np.log(diagonals(self.root)).sum(axis=1))


@lru_cache(maxsize=64)
def fixed_points(size: int) -> tuple[Array, Array]:
    """Two sets (S, size) of antithetic normal points, always the same, with means 0 and covariances I exactly.

    The second lie along random orthonormal frames at quantiles of the radius. Weights have heavy tails along a few
    axes, and of forty sets that leave radii to chance, the worst is a nat off.
    """
    random = np.random.default_rng(size)
    first = random.standard_normal((max(FIRST_PAIRS, size + MORE_PAIRS), size))
    frames = [np.linalg.qr(random.standard_normal((size, size)))[0] for _ in range(max(FRAMES, -(-LAST_PAIRS // size)))]
    directions = np.concatenate(frames)
    shares = (random.permutation(len(directions)) + 0.5) / len(directions)
    radii = np.sqrt(2.0 * gammaincinv(0.5 * size, shares))  # quantiles of the chi distribution
    return _balanced(first), _balanced(directions * radii[:, None])


def _balanced(half: Array) -> Array:
    """Points (2 S, n) of (S, n) ones and their mirror images, made to have the identity as covariance."""
    root = np.linalg.cholesky(half.T @ half / len(half))
    half = np.linalg.solve(root, half.T).T
    points: Array = np.concatenate([half, -half])
    points.setflags(write=False)
    return points
