"""The unobservable global scale ("metre") of a map that a robot builds without a prior map.

If all ranges are too long by a share s, so are map and path: no measurement shows it, as the scale of odometry is
unknown, too. States stay in the scale of the ranges; reported covariances include s ~ N(0, sigma^2), by which
everything scales about the robot's initial position.
"""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array


@dataclass(frozen=True)
class Metre:
    """Uncertainty of the global scale, and the fixed point of the scaling."""

    sigma: float  # standard deviation of s
    origin: Array  # (2,) fixed point, metres in map

    def slopes(self, states: Array, size: int) -> Array:
        """(n, w) change (Jacobian) of states (n, s) by one standard deviation of s, in tangent spaces of ``size`` w.

        It is in a pose's own frame, or in the map's frame for positions.
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
        """Marginal covariances (n, w, w) of states (n, s), widened by the scale's uncertainty."""
        slopes = self.slopes(states, covariances.shape[-1])
        return np.asarray(covariances + slopes[:, :, None] * slopes[:, None])

    def jointly_widened(self, states: Array, covariance: Array) -> Array:
        """Joint covariance (n w, n w) of states (n, s), widened by the scale's uncertainty."""
        slopes = self.slopes(states, len(covariance) // max(len(states), 1)).ravel()
        return np.asarray(covariance + slopes[:, None] * slopes)
