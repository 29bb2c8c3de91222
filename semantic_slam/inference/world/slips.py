"""Wheel slip: wheels that spin or lose contact for a moment, which the ordinary odometry noise does not cover.

Between two keyframes this happens with a small probability; the covariance of a slip is then added to that of the
motion. Which motions slipped is part of a history, coded in the modes of its lineage steps. A likely history is weighed
both with and without a slip, an unlikely one only without.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from semantic_slam.configuration import OdometryConfiguration
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.lineage import LineageStep
from semantic_slam.inference.world.carried import MODES

SLIPPED = MODES // 2
"""Added to a step's mode where the motion before it slipped; larger than any mode number of a component."""


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


def is_slipped(step: LineageStep) -> bool:
    """Whether the motion before a lineage step slipped; the step must not be the first one."""
    return step.mode % MODES >= SLIPPED


def with_slip(step: LineageStep) -> LineageStep:
    """The lineage step, marked as following a motion that slipped."""
    return replace(step, mode=step.mode + SLIPPED)


def without_slip(step: LineageStep) -> LineageStep:
    """The lineage step without the mark of a slip."""
    return replace(step, mode=step.mode - SLIPPED) if is_slipped(step) else step
