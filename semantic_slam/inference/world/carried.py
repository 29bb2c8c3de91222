"""A robot that is carried: lifted in mid-drive and set down elsewhere, of which odometry tells nothing.

From one keyframe to the next that happens with a small probability; where to is a Gaussian about where it was, and any
heading. No linearisation holds over metres and all headings: where a history has the robot carried, a point c of a
lattice over motions stands for where to, at which a Gaussian D takes the place of odometry and its peak is divided out,
as for the starts of a lost robot (``Starts``). The point is part of the history, in its step's mode.
"""

from dataclasses import dataclass, replace

import numpy as np

from semantic_slam.configuration import RevisionConfiguration
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.step import Motion, Step
from semantic_slam.inference.states.lineage import LineageStep
from semantic_slam.inference.world.starts import Starts

MODES = 64
"""More than a component has: a step's mode is that of its component, and so many times the point of the lattice."""
NOWHERE = 0
"""In place of a point: the robot went where odometry says."""


@dataclass(frozen=True)
class Carried:
    """Where a robot may be carried to, from where it was."""

    motions: Starts  # from nowhere: relative to the pose before
    log_odds: float  # of being carried between two keyframes

    @classmethod
    def of(cls, settings: RevisionConfiguration) -> "Carried | None":
        """As configured; None: it is never carried."""
        probability = settings.carried_probability
        if probability == 0.0:
            return None
        spread = np.diag([settings.carried_m, settings.carried_m, np.pi]) ** 2
        return cls(Starts(np.zeros(3), spread), float(np.log(probability) - np.log1p(-probability)))

    def step(self, step: Step, point: int) -> Step:
        """The keyframe with the motion to a point in place of odometry's."""
        told, there = step.motion, self.motions.prior(point)
        by_bias = None if told.by_bias is None else np.zeros_like(told.by_bias)
        shifts = None if told.shifts is None else np.zeros_like(told.shifts)
        return replace(step, motion=Motion(there.mean, there.covariance, by_bias, shifts))

    def log_weight(self, point: int, factor: float = 1.0) -> float:
        """Log of the odds of being carried there, where odometry's covariances are taken ``factor`` times as large."""
        return self.log_odds + self.motions.log_weight(point) + 1.5 * float(np.log(factor))

    def point(self, motion: Array) -> int | None:
        """The point next to a motion (3,); None beyond the lattice."""
        return self.motions.number(motion)


def carried_to(step: LineageStep) -> int:
    """The point of the lattice to which a step other than the first one has the robot carried, or NOWHERE."""
    return step.mode // MODES


def with_carried(step: LineageStep, point: int) -> LineageStep:
    """The step of a component's mode with the robot carried to a point."""
    return replace(step, mode=step.mode % MODES + MODES * point)
