"""GTSAM factor of a ray alone, from a camera anywhere on the robot and with any noise; GTSAM has none.

It is called for every ray that is relinearised, so GTSAM itself computes the transform of robot and point.
"""

from typing import Any

import gtsam
import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.callback_factor import callback_factor
from semantic_slam.inference.models.custom_factor import Sighting
from semantic_slam.inference.models.linear_factors import unit_noise
from semantic_slam.inference.models.spatial.detection import SpatialDetection
from semantic_slam.inference.models.spatial.ray import deviation, deviation_and_slopes


def with_tail(noise: Any, sigmas: float) -> Any:
    """A noise model with a Cauchy loss of scale ``sigmas``; 0: unchanged."""
    if sigmas <= 0.0:
        return noise
    return gtsam.noiseModel.Robust.Create(gtsam.noiseModel.mEstimator.Cauchy.Create(sigmas), noise)


def ray_factor(
    detection: SpatialDetection, keys: tuple[int, int], tail: float = 0.0, *, has_attitude: bool = False
) -> Any:
    """Factor on a robot, a Pose3, and a point: whitened deviation of the point from the ray in both directions.

    ``has_attitude``: whether the second is a Pose3, too, of which only the position is seen.
    """
    whiten, origin, ray, basis = detection.whiten[1:, 1:], detection.origin, detection.ray, detection.basis

    def error(this: Any, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
        robot, target = this.keys()
        pose, own = values.atPose3(robot), values.atPose3(target) if has_attitude else None
        place = values.atPoint3(target) if own is None else own.translation()
        if jacobians is None:
            return np.asarray(whiten @ deviation(pose.transformTo(place) - origin, ray, basis))
        by_robot, by_place = np.zeros((3, 6), order="F"), np.zeros((3, 3), order="F")
        seen = pose.transformTo(place, by_robot, by_place) - origin
        off, by_seen = deviation_and_slopes(seen, ray, basis)
        slopes = whiten @ by_seen
        jacobians[0] = np.asfortranarray(slopes @ by_robot)
        by_target = slopes @ by_place
        if own is not None:
            by_target = np.hstack([np.zeros((2, 3)), by_target @ own.rotation().matrix()])
        jacobians[1] = np.asfortranarray(by_target)
        return np.asarray(whiten @ off)

    return callback_factor(Sighting(detection, keys), keys, 2, error, with_tail(unit_noise(2), tail))
