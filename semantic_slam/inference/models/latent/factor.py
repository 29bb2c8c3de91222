"""The exact (nonlinear) GTSAM factor of X(k), O(n) and descriptor E(n): a callback at every relinearisation."""

from typing import Any

import gtsam
import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.latent.detection_features import DetectionFeatures
from semantic_slam.inference.models.latent.observation import LatentObservation
from semantic_slam.inference.models.linear_factors import unit_noise
from semantic_slam.inference.models.planar.detection import PlanarDetection


def exact_factor(observation: LatentObservation, detection: PlanarDetection, keys: tuple[int, ...]) -> Any:
    """Exact latent factor on X(k), O(n), E(n): a CustomFactor; an iSAM2 with it can be forked but not pickled."""
    features = DetectionFeatures.of([detection])

    def error(this: Any, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
        robot, target, descriptor = this.keys()
        x, o = _planar(values.atPose2(robot)), _planar(values.atPose2(target))
        part = observation.linearise(features, x, o, np.asarray(values.atVector(descriptor))[None])
        if jacobians is not None:
            for slot, jacobian in enumerate((part.by_robot, part.by_object, part.by_descriptor)):
                jacobians[slot] = np.asfortranarray(jacobian[0])
        return np.asarray(part.residual[0])

    return gtsam.CustomFactor(unit_noise(observation.model.num_features), list(keys), error)


def _planar(pose: Any) -> Array:
    return np.array([[pose.x(), pose.y(), pose.theta()]])
