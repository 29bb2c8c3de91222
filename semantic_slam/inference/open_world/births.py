"""Births: where the object that a detection starts would be, and the detection's evidence as a birth or a false alarm.

The position of such an object follows from the robot's pose and the detection alone. In the small problems in which
hypotheses are weighed, its position has a Gaussian stand-in prior about the measured point, fixed in the robot's frame
and a few times as wide as the measurement. The density of that prior at the point is divided out again, which leaves a
uniform birth intensity on the ground.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.observation import ObservationModel
from semantic_slam.inference.states.gaussian import GaussianPrior

WIDTH = 5.0
"""Standard deviation of the stand-in prior, in those of the measurement: wide, yet well conditioned."""


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


def birth_of(model: ObservationModel, detection: Any, robot: Array, field_of_view_rad: float) -> Birth:
    """The birth by ``detection``, seen from the predicted pose ``robot`` (3,).

    For a detection with a range an intensity of one is one object per square metre of the region; its evidence per
    metre and radian is then the range (the area element of a ring). For a bearing alone it is one object in the whole
    region.
    """
    prior = model.object_prior(detection, robot)
    gain = se2.adjoint(se2.between(prior.mean, robot))
    noise = np.diag([0.0, 0.0, prior.covariance[2, 2]])
    if not detection.has_range:
        return _along_bearing(detection, robot, prior, gain, noise, field_of_view_rad)
    cos, sin, reach = np.cos(detection.bearing_rad), np.sin(detection.bearing_rad), detection.range_m
    polar = np.array([[cos, -reach * sin], [sin, reach * cos]])
    noise[:2, :2] = polar @ detection.covariance @ polar.T
    by_error = np.zeros((3, 2))
    by_error[:2] = polar @ np.linalg.cholesky(detection.covariance)
    spread = noise.copy()
    spread[:2, :2] *= WIDTH**2
    stand_in = float(detection.log_normaliser - np.log1p(WIDTH**2))  # the stand-in is WIDTH^2 times the noise
    return Birth(
        prior=prior,
        gain=gain,
        spread=spread,
        noise=noise,
        by_error=by_error,
        log_area=float(np.log(reach)),
        log_stand_in=stand_in,
    )


def _along_bearing(
    detection: Any, robot: Array, prior: GaussianPrior, gain: Array, heading: Array, field_of_view_rad: float
) -> Birth:
    """The birth by a bearing alone; ``heading`` (3, 3) is the covariance of the object's heading, zero elsewhere.

    The prior, of variance p in all directions, is the stand-in prior. Given the bearing, the variance across it is
    p r / (p + r), with r = (reach times the bearing's standard deviation)^2: a Kalman update.
    """
    spread, variance = heading.copy(), prior.covariance[0, 0]
    spread[:2, :2] = prior.covariance[:2, :2]
    reach = float(np.hypot(*(se2.between(robot, prior.mean)[:2] - detection.origin)))
    by_bearing = reach**2 * detection.covariance[1, 1]
    gain_across = variance / (variance + by_bearing)
    along = np.array([np.cos(detection.bearing_rad), np.sin(detection.bearing_rad)])
    across = np.array([-along[1], along[0]])
    noise, by_error = heading.copy(), np.zeros((3, 2))
    noise[:2, :2] = variance * np.outer(along, along) + gain_across * by_bearing * np.outer(across, across)
    by_error[:2, 1] = gain_across * np.sqrt(by_bearing) * across
    stand_in = -0.5 * float(np.log(2.0 * np.pi * (detection.covariance[1, 1] + variance / reach**2)))
    return Birth(
        prior=prior,
        gain=gain,
        spread=spread,
        noise=noise,
        by_error=by_error,
        log_area=-float(np.log(field_of_view_rad)),
        log_stand_in=stand_in,
    )
