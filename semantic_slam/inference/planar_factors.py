"""GTSAM factors of the planar observation model.

A CustomFactor cannot be cloned or pickled, but an ISAM2 that holds one can be forked; a component is rebuilt
from its lineage, never from a pickled graph.
"""

from collections.abc import Callable
from typing import Any

import gtsam
import numpy as np
from numpy.typing import NDArray

from semantic_slam.inference.observation import Linearisation
from semantic_slam.inference.planar_detection import PlanarDetection
from semantic_slam.viewpoint.model import ViewpointModel, Viewpoints

Array = NDArray[np.float64]


def geometry_factor(
    linearise: Callable[[Array, Array], Linearisation], detection: PlanarDetection, keys: tuple[int, int]
) -> Any:
    """Built-in bearing-range factor; a bearing alone, from a camera off the body's origin, is a custom factor."""
    if detection.has_range:
        bearing_first = detection.covariance[::-1, ::-1]  # GTSAM's order is [bearing, range]
        noise = gtsam.noiseModel.Gaussian.Covariance(bearing_first)
        bearing = gtsam.Rot2.fromAngle(detection.bearing_rad)
        return gtsam.BearingRangeFactorPose2(*keys, bearing, detection.range_m, noise)

    def error(this: Any, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
        x, o = _planar_states(values, this.keys())
        part = linearise(x, o)
        if jacobians is not None:
            jacobians[0] = np.asfortranarray(part.jacobian_robot[0, 1:])
            jacobians[1] = np.asfortranarray(part.jacobian_object[0, 1:])
        return np.asarray(part.residual[0, 1:])

    return gtsam.CustomFactor(gtsam.noiseModel.Unit.Create(1), list(keys), error)


def semantic_factor(
    model: ViewpointModel, detection: PlanarDetection, keys: tuple[int, int], assigned_class: int, covariance: Array
) -> Any:
    """h_c(viewpoint) - z_sem with a fixed (F, F) covariance.

    The model's covariance depends on the viewpoint; it is taken where the factor is created, so that the
    factor is Gaussian. The weights of hypotheses use the covariance of each viewpoint.
    """
    whiten = np.linalg.inv(np.linalg.cholesky(covariance))
    classes = np.array([assigned_class])
    elevation = np.zeros(1)
    sensor_x, sensor_y = float(detection.sensor[0]), float(detection.sensor[1])
    feature = detection.feature

    def error(this: Any, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
        key_x, key_o = this.keys()
        x, o = values.atPose2(key_x), values.atPose2(key_o)
        v = o.transformTo(x.transformFrom(np.array([sensor_x, sensor_y])))
        distance = max(float(np.hypot(v[0], v[1])), 1e-6)
        viewpoint = Viewpoints(np.array([np.arctan2(v[1], v[0])]), elevation, np.array([distance]))
        prediction = model.predict(classes, viewpoint)
        if jacobians is not None:
            radial = np.array([v[0], v[1]]) / distance
            turn = np.array([-radial[1], radial[0]]) / distance
            slope = np.outer(prediction.mean_jacobian[0, :, 0], turn) + np.outer(
                prediction.mean_jacobian[0, :, 2], radial
            )
            angle = x.theta() - o.theta()
            cos, sin = np.cos(angle), np.sin(angle)
            by_turn = (-cos * sensor_y - sin * sensor_x, -sin * sensor_y + cos * sensor_x)
            by_x = np.array([[cos, -sin, by_turn[0]], [sin, cos, by_turn[1]]])
            by_o = np.array([[-1.0, 0.0, v[1]], [0.0, -1.0, -v[0]]])
            slope = whiten @ slope
            jacobians[0] = np.asfortranarray(slope @ by_x)
            jacobians[1] = np.asfortranarray(slope @ by_o)
        return np.asarray(whiten @ (prediction.mean[0] - feature))

    return gtsam.CustomFactor(gtsam.noiseModel.Unit.Create(len(feature)), list(keys), error)


def _planar_states(values: gtsam.Values, keys: list[int]) -> tuple[Array, Array]:
    poses = (values.atPose2(key) for key in keys)
    x, o = (np.array([[pose.x(), pose.y(), pose.theta()]]) for pose in poses)
    return x, o
