"""The metre of a map that a robot makes for itself: as long as the ranges of its detections have it.

Where all ranges are a share s too long, so are the map and the path: nothing measured tells, for odometry's metre is
unknown, too. States stay in the ranges' metre; what is stated of them counts s ~ N(0, sigma^2), by which all moves away
from where the robot began.
"""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array


@dataclass(frozen=True)
class Metre:
    """How well it is known, and where nothing moves by it."""

    sigma: float  # of the share s
    origin: Array  # (2,) metres, in map

    def slopes(self, states: Array, size: int) -> Array:
        """(n, w) change of states (n, s) by one standard deviation of s, in tangent spaces of ``size`` w.

        Those of poses are in their own frames, those of positions in the map's.
        """
        found = np.zeros((len(states), size))
        found[:, :2] = self.sigma * (states[:, :2] - self.origin)
        if states.shape[1] > 2:
            yaw = np.nan_to_num(states[:, 2])
            cos, sin = np.cos(yaw), np.sin(yaw)
            turned = np.stack([np.stack([cos, sin], axis=-1), np.stack([-sin, cos], axis=-1)], axis=-2)
            found[:, :2] = (turned @ found[:, :2, None])[..., 0]
        return found

    def widened(self, states: Array, covariances: Array) -> Array:
        """Covariances (n, w, w) of states (n, s), each by itself."""
        slopes = self.slopes(states, covariances.shape[-1])
        return np.asarray(covariances + slopes[:, :, None] * slopes[:, None])

    def jointly_widened(self, states: Array, covariance: Array) -> Array:
        """Covariance (n w, n w) of states (n, s) together."""
        slopes = self.slopes(states, len(covariance) // max(len(states), 1)).ravel()
        return np.asarray(covariance + slopes[:, None] * slopes)
