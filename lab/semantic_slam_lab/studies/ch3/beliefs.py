"""What a simulated SLAM believes of the track, view by view."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.classification.track_posterior import GaussianTrack
from semantic_slam.geometry.arrays import Array

START_SIGMA_M, ODOMETRY_SIGMA_M, FIX_SIGMA_M = 2.0, 0.4, 0.3
FIXED_VIEWS = (7, 14)


@dataclass(frozen=True)
class Fix:
    """The camera's location measured at one view."""

    view: int
    location_m: Array  # (2,)
    sigma_m: float


@dataclass(frozen=True)
class Belief:
    """A Gaussian over K locations, changed by every fix as soon as its view has come."""

    mean_m: Array  # (K, 2) without fixes
    covariance: Array  # (K, K) of each coordinate, without fixes
    fixes: tuple[Fix, ...] = ()
    rigid: bool = False  # one offset moves the whole track

    def mean(self, k: int) -> Array:
        """(k + 1, 2) mean locations [m] after view k."""
        return self._moments(k)[0]

    def posterior(self, k: int) -> GaussianTrack:
        """Gaussian belief of the track up to and with view k."""
        mean, covariance = self._moments(k)
        return GaussianTrack(mean, np.asarray(np.kron(covariance, np.eye(2)), dtype=np.float64))

    def _moments(self, k: int) -> tuple[Array, Array]:
        mean, covariance = self.mean_m[: k + 1], self.covariance[: k + 1, : k + 1]
        for fix in (fix for fix in self.fixes if fix.view <= k):
            gain = covariance[:, fix.view] / (covariance[fix.view, fix.view] + fix.sigma_m**2)
            mean = mean + np.outer(gain, fix.location_m - mean[fix.view])
            covariance = covariance - np.outer(gain, covariance[fix.view])
        return mean, covariance


def biased(estimate_m: Array, sigma_m: float, *, shared: bool) -> Belief:
    """An estimate that is off, believed to ``sigma_m``: by one offset for all views, or by one at each."""
    count = len(estimate_m)
    return Belief(estimate_m, sigma_m**2 * (np.ones((count, count)) if shared else np.eye(count)), rigid=shared)


def odometry_with_fixes(track_m: Array, generator: np.random.Generator) -> Belief:
    """A random walk about the truth from an uncertain start, and position fixes at some views."""
    steps = np.arange(len(track_m))
    covariance = START_SIGMA_M**2 + ODOMETRY_SIGMA_M**2 * np.minimum.outer(steps, steps)
    walk = ODOMETRY_SIGMA_M * generator.standard_normal(track_m.shape)
    walk[0] = START_SIGMA_M * generator.standard_normal(2)
    fixes = tuple(
        Fix(view, track_m[view] + FIX_SIGMA_M * generator.standard_normal(2), FIX_SIGMA_M) for view in FIXED_VIEWS
    )
    return Belief(track_m + np.cumsum(walk, axis=0), covariance, fixes)
