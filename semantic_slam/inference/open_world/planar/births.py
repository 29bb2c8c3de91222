"""Births in the plane: the objects that detections of a range and a bearing, or of a bearing alone, start."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.observation import ObservationModel
from semantic_slam.inference.models.planar.polar import from_polar
from semantic_slam.inference.open_world.births import WIDTH, Birth, LineOfSight
from semantic_slam.inference.open_world.planar.region import SensorRegion
from semantic_slam.inference.states.gaussian import GaussianPrior


def births_of(model: ObservationModel, detections: Sequence[Any], robot: Array, region: SensorRegion) -> list[Birth]:
    """The births by ``detections``, seen from the predicted pose ``robot`` (3,).

    For a detection with a range an intensity of one is one object per square metre of the region; its evidence per
    metre and radian is then the range (the area element of a ring). For a bearing alone it is one object in the whole
    region.
    """
    priors = [model.object_prior(own, robot) for own in detections]
    gains = [se2.adjoint(se2.between(own.mean, robot)) for own in priors]
    given = list(zip(detections, priors, gains, strict=True))
    at_ranges = iter(_at_ranges([own for own in given if own[0].has_range]))
    return [
        next(at_ranges) if detection.has_range else _along_bearing(detection, robot, prior, gain, region)
        for detection, prior, gain in given
    ]


def _at_ranges(given: Sequence[tuple[Any, GaussianPrior, Array]]) -> list[Birth]:
    """The births by n detections with a range, ``given`` with their priors and (3, 3) gains."""
    count = len(given)
    reach = np.array([own.range_m for own, _, _ in given])
    _, polar = from_polar(reach, np.array([own.bearing_rad for own, _, _ in given]))
    covariances = np.array([own.covariance for own, _, _ in given]).reshape(count, 2, 2)
    noise, by_error = np.zeros((count, 3, 3)), np.zeros((count, 3, 2))
    noise[:, :2, :2] = polar @ covariances @ np.swapaxes(polar, 1, 2)
    noise[:, 2, 2] = [prior.covariance[2, 2] for _, prior, _ in given]
    by_error[:, :2] = polar @ np.linalg.cholesky(covariances)
    spread = noise.copy()
    spread[:, :2, :2] *= WIDTH**2
    log_width = np.log1p(WIDTH**2)  # the stand-in is WIDTH^2 times the noise
    return [
        Birth(
            prior=prior,
            gain=gain,
            spread=spread[number],
            noise=noise[number],
            by_error=by_error[number],
            log_area=log_area,
            log_stand_in=float(detection.log_normaliser - log_width),
        )
        for number, ((detection, prior, gain), log_area) in enumerate(zip(given, np.log(reach).tolist(), strict=True))
    ]


def _along_bearing(detection: Any, robot: Array, prior: GaussianPrior, gain: Array, region: SensorRegion) -> Birth:
    """The birth by a bearing alone.

    The prior, of variance p in all directions, is the stand-in prior. Given the bearing, the variance across it is
    p r / (p + r), with r = (reach times the bearing's standard deviation)^2: a Kalman update.
    """
    variance, noise, by_error = prior.covariance[0, 0], np.zeros((3, 3)), np.zeros((3, 2))
    noise[2, 2] = prior.covariance[2, 2]
    spread = noise.copy()
    spread[:2, :2] = prior.covariance[:2, :2]
    reach = float(np.hypot(*(se2.between(robot, prior.mean)[:2] - detection.origin)))
    by_bearing = reach**2 * detection.covariance[1, 1]
    gain_across = variance / (variance + by_bearing)
    along = np.array([np.cos(detection.bearing_rad), np.sin(detection.bearing_rad)])
    across = np.array([-along[1], along[0]])
    noise[:2, :2] = variance * np.outer(along, along) + gain_across * by_bearing * np.outer(across, across)
    by_error[:2, 1] = gain_across * np.sqrt(by_bearing) * across
    stand_in = -0.5 * float(np.log(2.0 * np.pi * (detection.covariance[1, 1] + variance / reach**2)))
    return Birth(
        prior=prior,
        gain=gain,
        spread=spread,
        noise=noise,
        by_error=by_error,
        log_area=-float(np.log(region.field_of_view_rad)),
        log_stand_in=stand_in,
        line=_line(detection, robot, region),
    )


def _line(detection: Any, robot: Array, region: SensorRegion) -> LineOfSight:
    """The line of sight of a bearing alone, from the pose ``robot`` (3,)."""
    cos, sin = np.cos(robot[2]), np.sin(robot[2])
    ahead = detection.bearing_rad + robot[2]
    return LineOfSight(
        origin=robot[:2] + np.array([[cos, -sin], [sin, cos]]) @ detection.origin,
        direction=np.array([np.cos(ahead), np.sin(ahead)]),
        variance=float(detection.covariance[1, 1]),
        log_extent=float(np.log(region.area_m2 / region.field_of_view_rad)),
    )
