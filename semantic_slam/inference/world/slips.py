"""Odometry that slips: wheels that spin or are lifted for a moment, of which the noise of other motions says nothing.

From one keyframe to the next that happens with a small probability, and then the motion has a slip's covariance beside
its own. Which motions slipped is part of a history, in the modes of its steps. A likely history is weighed both with
a slip and without one, an unlikely one without one alone.
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
"""More than a component has modes: added to a step's mode where the motion before it slipped."""


@dataclass(frozen=True)
class Slips:
    """How often odometry slips, and by how much."""

    share: float  # of the motions between keyframes
    covariance: Array  # (3, 3) in the robot's tangent space, beside that of other motions

    @classmethod
    def of(cls, settings: OdometryConfiguration) -> "Slips | None":
        """As configured; None: it never does."""
        if settings.slip_share == 0.0:
            return None
        sigmas = np.array([settings.sigma_slip_m, settings.sigma_slip_m, settings.sigma_slip_rad])
        return cls(settings.slip_share, np.diag(sigmas**2))

    def slipping(self, component: Component) -> Component:
        """The component, whose next motion slips."""
        return replace(component, slip=self.covariance)

    def log_weights(self, components: Sequence[Component]) -> Array:
        """(P,) log probabilities that the next motion slips, or does not, as components have it."""
        slip = np.array([own.slip is not None for own in components])
        return np.asarray(np.where(slip, np.log(self.share), np.log1p(-self.share)))


def is_slipped(step: LineageStep) -> bool:
    """Whether a history has the motion slip before a keyframe other than the first one."""
    return step.mode % MODES >= SLIPPED


def with_slip(step: LineageStep) -> LineageStep:
    """The step of a component's mode, after a motion that slipped."""
    return replace(step, mode=step.mode + SLIPPED)


def without_slip(step: LineageStep) -> LineageStep:
    """The step with its component's mode alone."""
    return replace(step, mode=step.mode - SLIPPED) if is_slipped(step) else step
