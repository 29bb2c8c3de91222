"""Scores of views that no class model explains: what a classifier says when it is sure of the wrong thing.

A view is an outlier with a probability e, whatever the object's class. Its score then has a broad density, the Gaussian
with the moments of all that the models predict, over classes and directions: normalised, so that evidences stay
comparable. The density (1 - e) p(s | c, viewpoint) + e p_out(s) never falls below e p_out(s), so that one view can cost
a class no more than log(1 / e) and what its score tells at its peak over p_out.
"""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.viewpoint.model import ViewpointModel, all_around, log_density

DIRECTIONS = 72
"""Azimuths over which predictions are averaged: every 5 degrees."""


@dataclass(frozen=True)
class OutlierScores:
    """The share e of outliers among views, and their density; F components of a score."""

    share: float  # 0 <= e < 1
    mean: Array  # (F,)
    covariance: Array  # (F, F)

    @classmethod
    def of(cls, model: ViewpointModel, share: float) -> "OutlierScores":
        """Density with the mean and the covariance of all scores that the models predict, all classes alike."""
        expected = model.predict(*all_around(model, DIRECTIONS))
        mean = expected.mean.mean(axis=0)
        off = expected.mean - mean
        return cls(share, mean, off.T @ off / len(off) + expected.covariance.mean(axis=0))

    def log_density(self, features: Array, covariances: Array) -> Array:
        """(B,) log p_out of (B, F) scores with the (B, F, F) covariances of their dropout passes, in nats."""
        return log_density(features - self.mean, self.covariance + covariances)

    def mixed(self, log_inlier: Array, log_outlier: Array) -> tuple[Array, Array]:
        """Log of (1 - e) p + e p_out from the two log densities, and the posterior that the view is no outlier."""
        inlier = np.log1p(-self.share) + log_inlier
        with np.errstate(divide="ignore"):
            log_mixed = np.logaddexp(inlier, np.log(self.share) + log_outlier)
        return log_mixed, np.exp(inlier - log_mixed)
