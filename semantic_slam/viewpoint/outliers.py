"""Outlier model of classifier scores: views that no class model explains, such as confident wrong answers.

A view is an outlier with probability e, whatever the object's class. Its score then has a broad density p_out, the
Gaussian with the moments of all model predictions over classes and directions; it is normalised, so that evidences stay
comparable. The mixture (1 - e) p(s | c, viewpoint) + e p_out(s) never falls below e p_out(s), so that one view can cost
a class no more than log(1 / e) plus the log ratio of its peak density to p_out.
"""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.viewpoint.model import ViewpointModel, all_around, log_density

DIRECTIONS = 72
"""Number of azimuths over which predictions are averaged: every 5 degrees."""


@dataclass(frozen=True)
class OutlierScores:
    """Outlier share e and Gaussian outlier density p_out; F score components."""

    share: float  # 0 <= e < 1
    mean: Array  # (F,)
    covariance: Array  # (F, F)

    @classmethod
    def of(cls, model: ViewpointModel, share: float) -> "OutlierScores":
        """Outlier density with the mean and covariance of all predicted scores, classes weighted equally."""
        expected = model.predict(*all_around(model, DIRECTIONS))
        mean = expected.mean.mean(axis=0)
        off = expected.mean - mean
        return cls(share, mean, off.T @ off / len(off) + expected.covariance.mean(axis=0))

    def log_density(self, features: Array, covariances: Array) -> Array:
        """(B,) log p_out of (B, F) scores with the (B, F, F) covariances of their dropout passes, in nats."""
        return log_density(features - self.mean, self.covariance + covariances)

    def mixed(self, log_inlier: Array, log_outlier: Array) -> tuple[Array, Array]:
        """Log of (1 - e) p + e p_out from the two log densities, and the posterior inlier probability of the view."""
        inlier = np.log1p(-self.share) + log_inlier
        with np.errstate(divide="ignore"):
            log_mixed = np.logaddexp(inlier, np.log(self.share) + log_outlier)
        return log_mixed, np.exp(inlier - log_mixed)
