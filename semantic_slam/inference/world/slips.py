"""Wheel slip: wheels that spin or lose contact for a moment, which the ordinary odometry noise does not cover.

Between two keyframes this happens with a small probability; the covariance of a slip is then added to that of the
motion. Which motions slipped is part of a history, coded in its lineage steps. A likely history is weighed
both with and without a slip, an unlikely one only without.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from semantic_slam.configuration import OdometryConfiguration
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.smoothing.component import Component


@dataclass(frozen=True)
class Slips:
    """Prior of wheel slip: its probability per motion, and its covariance."""

    share: float  # probability that the motion between two keyframes slips
    covariance: Array  # (3, 3) in the robot's tangent space, added to that of the motion

    @classmethod
    def of(cls, settings: OdometryConfiguration) -> "Slips | None":
        """The prior of the configuration; None if odometry never slips."""
        if settings.slip_share == 0.0:
            return None
        sigmas = np.array([settings.sigma_slip_m, settings.sigma_slip_m, settings.sigma_slip_rad])
        return cls(settings.slip_share, np.diag(sigmas**2))

    def slipping(self, component: Component) -> Component:
        """The component, with a slip in its next motion."""
        return replace(component, slip=self.covariance)

    def log_weights(self, components: Sequence[Component]) -> Array:
        """(P,) log prior probability of each component's choice: that its next motion slips, or does not."""
        slip = np.array([own.slip is not None for own in components])
        return np.asarray(np.where(slip, np.log(self.share), np.log1p(-self.share)))
