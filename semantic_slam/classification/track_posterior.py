"""Posterior distributions over the camera track relative to the object."""

from typing import Protocol

import numpy as np
from scipy.linalg import solve_triangular

from semantic_slam.geometry.arrays import Array

RELATIVE_JITTER = 1e-9
"""Jitter added to all variances, relative to the largest: tracks with one common offset are singular."""


class TrackPosterior(Protocol):
    """Interface of p(X_0:k, o | H_k) as camera locations relative to the object, K = k + 1 views."""

    def sample(self, count: int, generator: np.random.Generator) -> Array:
        """(count, K, 2) tracks drawn from the posterior."""

    def extend(self, tracks: Array, generator: np.random.Generator) -> Array:
        """(P, 2) locations of view k, sampled conditionally on the (P, k, 2) earlier locations."""

    def move(self, tracks: Array, share: Array, generator: np.random.Generator) -> Array:
        """(P, k, 2) nearby tracks by a posterior-preserving move; ``share`` (P,) is the step size, 0..1."""

    def log_density(self, tracks: Array) -> Array:
        """(P,) log density of the first views, (P, k, 2) with k <= K, up to a constant per k."""


class GaussianTrack:
    """Gaussian over all locations of a track, as given by SLAM's joint marginals."""

    def __init__(self, mean_m: Array, covariance: Array) -> None:
        """``mean_m`` (K, 2); ``covariance`` (2 K, 2 K), ordered x0 y0 x1 y1 ..., positive semi-definite."""
        self._mean = np.asarray(mean_m, dtype=np.float64).reshape(-1)
        jitter = RELATIVE_JITTER * np.diagonal(covariance).max()
        self._factor = np.linalg.cholesky(covariance + jitter * np.eye(self._mean.size))

    def sample(self, count: int, generator: np.random.Generator) -> Array:
        """(count, K, 2) tracks drawn from the Gaussian."""
        drawn = generator.standard_normal((count, self._mean.size))
        return np.asarray(self._mean + drawn @ self._factor.T).reshape(count, -1, 2)

    def extend(self, tracks: Array, generator: np.random.Generator) -> Array:
        """(P, 2) locations of view k given the (P, k, 2) before it."""
        before = 2 * tracks.shape[1]
        newest = slice(before, before + 2)
        shift = self._whitened(tracks).T @ self._factor[newest, :before].T
        drawn = generator.standard_normal((len(tracks), 2))
        return np.asarray(self._mean[newest] + shift + drawn @ self._factor[newest, newest].T)

    def move(self, tracks: Array, share: Array, generator: np.random.Generator) -> Array:
        """(P, k, 2) tracks mixed with fresh samples such that the covariance is kept: reversible for this Gaussian."""
        count, size = len(tracks), 2 * tracks.shape[1]
        fresh = generator.standard_normal((count, size)) @ self._factor[:size, :size].T
        centred = tracks.reshape(count, size) - self._mean[:size]
        mixed = np.sqrt(1.0 - share**2)[:, None] * centred + share[:, None] * fresh
        return np.asarray(self._mean[:size] + mixed).reshape(count, -1, 2)

    def log_density(self, tracks: Array) -> Array:
        """(P,) log density of the first views [nats], without the constant in 2 pi."""
        whitened = self._whitened(tracks)
        logdet = np.log(np.diagonal(self._factor)[: len(whitened)]).sum()
        return np.asarray(-0.5 * np.square(whitened).sum(axis=0) - logdet)

    def _whitened(self, tracks: Array) -> Array:
        """(2 k, P) first views of the tracks, centred and whitened by the posterior's covariance."""
        size = 2 * tracks.shape[1]
        centred = (tracks.reshape(len(tracks), size) - self._mean[:size]).T
        return np.asarray(solve_triangular(self._factor[:size, :size], centred, lower=True))
