"""Objects that detections start: where they would be, and what a detection of none that is known weighs.

Where such an object is follows from the robot and from the detection alone. In the small problems of the weights its
position has a Gaussian about the measured one, in the robot's frame and a few times as wide as the measurement, and
its density at that point is divided out again: what stays is an even intensity on the ground, whatever the robot's pose.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry import se2
from semantic_slam.inference.gaussian import GaussianPrior
from semantic_slam.inference.observation import ObservationModel

Array = NDArray[np.float64]

WIDTH = 5.0
"""Standard deviations of the stand-in prior in those of the measurement: wide, and yet well conditioned."""


@dataclass(frozen=True)
class Birth:
    """An object that one detection would start in one hypothesis (planar poses)."""

    prior: GaussianPrior  # broad, for the graph
    gain: Array  # (3, 3) how the object moves with the robot
    spread: Array  # (3, 3) covariance given the robot, of the small problems
    log_scale: float  # log of the detection's evidence under an intensity of one, less that under ``spread``
    log_area: float  # log of the detection's evidence under an intensity of one


def birth_of(model: ObservationModel, detection: Any, robot: Array, field_of_view_rad: float) -> Birth:
    """The object that ``detection`` starts, seen from the predicted ``robot`` (3,).

    An intensity is one per square metre of the region for a detection with a range: its evidence per metre and radian
    is then the range, a ring's area. It is one in the whole region for a bearing alone.
    """
    prior = model.object_prior(detection, robot)
    gain = se2.adjoint(se2.between(prior.mean, robot))
    along, across = _widths(detection, prior)
    cos, sin = np.cos(detection.bearing_rad), np.sin(detection.bearing_rad)
    turn = np.array([[cos, -sin], [sin, cos]])
    spread = np.zeros((3, 3))
    spread[:2, :2] = turn @ np.diag([along**2, across**2]) @ turn.T
    spread[2, 2] = prior.covariance[2, 2]
    part = model.geometry(detection, robot[None], prior.mean[None])
    jacobian = part.jacobian_object[0]
    own = jacobian @ spread @ jacobian.T + np.eye(len(jacobian))
    log_evidence = float(part.log_normaliser[0] - 0.5 * np.linalg.slogdet(own)[1])
    log_area = float(np.log(detection.range_m) if detection.has_range else -np.log(field_of_view_rad))
    return Birth(prior, gain, spread, log_area - log_evidence, log_area)


def _widths(detection: Any, prior: GaussianPrior) -> tuple[float, float]:
    """Standard deviations [m] along and across the line of sight."""
    if not detection.has_range:
        sigma = float(np.sqrt(prior.covariance[0, 0]))
        return sigma, sigma
    sigma_range, sigma_bearing = np.sqrt(np.diag(detection.covariance))
    return WIDTH * float(sigma_range), WIDTH * float(sigma_bearing) * float(detection.range_m)
