"""A robot that is carried: lifted in mid-drive and set down elsewhere, of which odometry tells nothing.

From one keyframe to the next that happens with a small probability; where to is a Gaussian about where it was, and any
heading. No linearisation holds over metres and all headings: where a history has the robot carried, a point c of a
lattice over motions stands for where to, at which a Gaussian D takes the place of odometry and its peak is divided out,
as for the starts of a lost robot (``Starts``). The point is part of the history, in its step's mode.

Or it is set down on new ground: where it is nobody says, it maps in a frame of its own and meets nothing that it knew
before, as a lost robot does that is not placed. Its detections weigh the same wherever that frame lies.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from semantic_slam.configuration import RevisionConfiguration
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.step import Motion, Step
from semantic_slam.inference.states.lineage import LineageStep
from semantic_slam.inference.world.starts import ANYWHERE, Starts

MODES = 64
"""More than a component has: a step's mode is that of its component, and so many times the point of the lattice."""
NOWHERE = 0
"""In place of a point: the robot went where odometry says."""
NEW_GROUND = 1
"""In place of a point: the robot was carried, where to is not said, and sees nothing that it knew."""
FIRST_POINT = 2
"""Number of the first point of the lattice."""


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
        told, there = step.motion, self.motions.prior(_number(point))
        by_bias = None if told.by_bias is None else np.zeros_like(told.by_bias)
        shifts = None if told.shifts is None else np.zeros_like(told.shifts)
        return replace(step, motion=Motion(there.mean, there.covariance, by_bias, shifts))

    def log_weight(self, point: int, factor: float = 1.0) -> float:
        """Log of the odds of being carried there, where odometry's covariances are taken ``factor`` times as large."""
        if point == NEW_GROUND:
            return self.log_odds
        return self.log_odds + self.motions.log_weight(_number(point)) + 1.5 * float(np.log(factor))

    @cached_property
    def log_place(self) -> float:
        """Log of the odds of a point close by to those of being carried at all."""
        return self.motions.log_weight(self.motions.number(np.zeros(3)) or ANYWHERE)

    def point(self, motion: Array) -> int | None:
        """The point next to a motion (3,); None beyond the lattice."""
        number = self.motions.number(motion)
        return None if number is None else number - 1 + FIRST_POINT

    def frame(self, before: Array, times: int = 1) -> Starts:
        """Where the frame lies of a robot on new ground, carried so many times, that was at ``before`` (3,) first."""
        return Starts(before, times * self.motions.covariance)


def _number(point: int) -> int:
    """What ``Starts`` call a point of the lattice; ANYWHERE on new ground."""
    return point + 1 - FIRST_POINT if point >= FIRST_POINT else ANYWHERE


def carried_to(step: LineageStep) -> int:
    """The point of the lattice to which a step other than the first one has the robot carried, or NOWHERE."""
    return step.mode // MODES


def new_grounds(lineage: Sequence[LineageStep]) -> tuple[int, ...]:
    """The keyframes before which a history has the robot set down on new ground."""
    return tuple(k for k, step in enumerate(lineage) if k and carried_to(step) == NEW_GROUND)


def with_carried(step: LineageStep, point: int) -> LineageStep:
    """The step of a component's mode with the robot carried to a point."""
    return replace(step, mode=step.mode % MODES + MODES * point)
