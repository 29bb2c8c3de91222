"""Births: where the object that a detection starts would be, and the detection's evidence as a birth or a false alarm.

The position of such an object follows from the robot's pose and the detection alone. In the small problems in which
hypotheses are weighed, its position has a Gaussian stand-in prior about the measured point, fixed in the robot's frame
and a few times as wide as the measurement. The density of that prior at the point is divided out again, which leaves a
uniform birth intensity on the ground.
"""

from dataclasses import dataclass

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.states.gaussian import GaussianPrior

WIDTH = 5.0
"""Standard deviation of the stand-in prior, in those of the measurement: wide, yet well conditioned."""


@dataclass(frozen=True, kw_only=True)
class LineOfSight:
    """Ray in map on which the object of a range-less detection lies, with its angular variance."""

    origin: Array  # (p,) metres
    direction: Array  # (p,) unit vector
    variance: float  # rad^2 about each axis across the ray
    log_extent: float  # log of the region's area [m^2] per radian or, in space, of its volume [m^3] per square radian


@dataclass(frozen=True, kw_only=True)
class Birth:
    """The object that one detection would start in one hypothesis (planar poses)."""

    prior: GaussianPrior  # broad prior, for the factor graph
    gain: Array  # (3, 3) Jacobian of the object's pose by the robot's
    spread: Array  # (3, 3) covariance of the stand-in prior given the robot
    noise: Array  # (3, 3) covariance given the robot and the detection
    by_error: Array  # (3, 2) Jacobian of its position by the detection's whitened error
    log_area: float  # log evidence of the detection under a birth intensity of one
    log_stand_in: float  # log evidence of the detection under the stand-in prior ``spread``
    line: LineOfSight | None = None  # None: the detection has a range
