"""The kidnapped robot ("carried"): lifted in mid-drive and set down elsewhere, unnoticed by odometry.

Between two keyframes this happens with a small probability; the new position is Gaussian about the old one, the heading
arbitrary. A single linearisation does not hold over metres and all headings. So a history in which the robot was
carried names a point c of a lattice over relative motions; there a narrow Gaussian D replaces the odometry factor, and
its peak density is divided out, as for the starts of a lost robot (``Starts``). The point is part of the history: it is
coded in its lineage step.

Alternatively the robot is set down on "new ground": its position is left open, it maps in a local frame and re-observes
no object that it knew before, like a lost robot that is not localised yet. The weight of its detections does not depend
on where that frame lies.
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

NOWHERE = 0
"""In place of a lattice point: the robot was not carried, odometry holds."""
NEW_GROUND = 1
"""In place of a lattice point: carried to an unknown position, where the robot re-observes no known object."""
FIRST_POINT = 2
"""Number of the first point of the lattice."""
SOON = 40
"""Keyframes within which the robot is not carried twice, as long as some history was not carried in them."""


@dataclass(frozen=True)
class Carried:
    """Prior of a kidnapping: its probability between two keyframes, and the lattice of relative motions."""

    motions: Starts  # relative motions, in the frame of the pose before: zero mean
    log_odds: float  # of being carried between two keyframes

    @classmethod
    def of(cls, settings: RevisionConfiguration) -> "Carried | None":
        """The prior of the configuration; None if the robot is never carried."""
        probability = settings.carried_probability
        if probability == 0.0:
            return None
        spread = np.diag([settings.carried_m, settings.carried_m, np.pi]) ** 2
        return cls(Starts(np.zeros(3), spread), float(np.log(probability) - np.log1p(-probability)))

    def step(self, step: Step, point: int) -> Step:
        """The keyframe's step with the odometry replaced by the motion to a lattice point."""
        told, there = step.motion, self.motions.prior(_number(point))
        by_bias = None if told.by_bias is None else np.zeros_like(told.by_bias)
        shifts = None if told.shifts is None else np.zeros_like(told.shifts)
        return replace(step, motion=Motion(there.mean, there.covariance, by_bias, shifts))

    def log_weight(self, point: int, factor: float = 1.0) -> float:
        """Log prior odds of being carried to a lattice point, or onto new ground.

        ``factor`` is that by which the hypothesis scales odometry covariances; it cancels its effect on the stand-in.
        """
        if point == NEW_GROUND:
            return self.log_odds
        return self.log_odds + self.motions.log_weight(_number(point)) + 1.5 * float(np.log(factor))

    @cached_property
    def log_place(self) -> float:
        """Log prior weight of the lattice point of zero motion, relative to being carried at all."""
        return self.motions.log_weight(self.motions.number(np.zeros(3)) or ANYWHERE)

    def point(self, motion: Array) -> int | None:
        """The lattice point nearest to a relative motion (3,); None beyond the lattice."""
        number = self.motions.number(motion)
        return None if number is None else number - 1 + FIRST_POINT

    def frame(self, before: Array, times: int = 1) -> Starts:
        """Prior of the local frame's pose, for a robot that was at ``before`` (3,) until carried ``times`` times."""
        return Starts(before, times * self.motions.covariance)


def _number(point: int) -> int:
    """Number of a lattice point within ``Starts``; ANYWHERE for new ground."""
    return point + 1 - FIRST_POINT if point >= FIRST_POINT else ANYWHERE


def is_carried_lately(lineage: Sequence[LineageStep]) -> bool:
    """Whether the robot of a history was carried before one of its last ``SOON`` steps."""
    return any(step.lattice_point for step in lineage[max(len(lineage) - SOON, 1) :])


def new_grounds(lineage: Sequence[LineageStep], first: int = 0) -> tuple[int, ...]:
    """The keyframes before which the robot was set down on new ground, in a history from keyframe ``first`` on."""
    return tuple(k for k, step in enumerate(lineage, start=first) if k and step.lattice_point == NEW_GROUND)
