"""Viewpoint-change model P(f(z2) | f(z1), change) (Sec. 5.1): it neither needs nor estimates the object's pose.

It also holds for objects without a front. Its predicted uncertainty depends on the first view and on the change.
"""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.latent.direction import encoded
from semantic_slam.latent.smooth_network import SmoothNetwork
from semantic_slam.viewpoint.model import Viewpoints

SMALLEST_LOG_SIGMA, LARGEST_LOG_SIGMA = -5.0, 5.0
"""Bounds of the predicted log standard deviation of the second view's features."""


@dataclass(frozen=True)
class ChangePrediction:
    """Diagonal Gaussian over the second view's feature."""

    mean: Array  # (B, F)
    sigma: Array  # (B, F)

    def log_likelihood(self, features: Array) -> Array:
        """(B,) log likelihood of (B, F) second-view features, in nats."""
        residual = (features - self.mean) / self.sigma
        return np.asarray(
            -(0.5 * residual**2 + np.log(self.sigma)).sum(axis=1) - 0.5 * len(self.mean.T) * np.log(2 * np.pi)
        )


@dataclass(frozen=True)
class ChangeModel:
    """Network model N(f2; mu(f1, change), Sigma(f1, change))."""

    network: SmoothNetwork

    def predict(self, features: Array, change_rad: Array) -> ChangePrediction:
        """Predict second-view features from (B, F) first-view features and (B, 2) azimuth/elevation changes [rad]."""
        outputs = self.network.value(np.hstack([features, encoded_change(change_rad)]))
        step, log_sigma = np.split(outputs, 2, axis=1)
        return ChangePrediction(features + step, np.exp(np.clip(log_sigma, SMALLEST_LOG_SIGMA, LARGEST_LOG_SIGMA)))


def encoded_change(change_rad: Array) -> Array:
    """(B, NUM_INPUTS) network inputs for (B, 2) changes of azimuth and elevation."""
    return encoded(Viewpoints(change_rad[:, 0], change_rad[:, 1], np.zeros(len(change_rad))))
