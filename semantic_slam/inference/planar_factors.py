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

Array = NDArray[np.float64]


def bearing_range_factor(detection: PlanarDetection, keys: tuple[int, int]) -> Any:
    """GTSAM's own."""
    noise = gtsam.noiseModel.Gaussian.Covariance(detection.covariance[::-1, ::-1])  # GTSAM's order is [bearing, range]
    bearing = gtsam.Rot2.fromAngle(detection.bearing_rad)
    return gtsam.BearingRangeFactorPose2(*keys, bearing, detection.range_m, noise)


def bearing_factor(linearise: Callable[[Array, Array], Linearisation], keys: tuple[int, int]) -> Any:
    """A bearing alone, from a camera off the body's origin, is a custom factor."""

    def error(this: Any, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
        x, o = _planar_states(values, this.keys())
        part = linearise(x, o)
        if jacobians is not None:
            jacobians[0] = np.asfortranarray(part.jacobian_robot[0, 1:])
            jacobians[1] = np.asfortranarray(part.jacobian_object[0, 1:])
        return np.asarray(part.residual[0, 1:])

    return gtsam.CustomFactor(gtsam.noiseModel.Unit.Create(1), list(keys), error)


def linear_factor(keys: tuple[int, int], part: Linearisation, row: int, x: Array, o: Array) -> Any:
    """One row of a linearisation at (3,) robot ``x`` and object ``o``: no callback, but true near those states only."""
    noise = gtsam.noiseModel.Unit.Create(part.residual.shape[1])
    by_robot, by_object = np.asfortranarray(part.jacobian_robot[row]), np.asfortranarray(part.jacobian_object[row])
    values = gtsam.Values()
    values.insert(keys[0], gtsam.Pose2(*x))
    values.insert(keys[1], gtsam.Pose2(*o))
    linear = gtsam.JacobianFactor(keys[0], by_robot, keys[1], by_object, -part.residual[row], noise)
    return gtsam.LinearContainerFactor(linear, values)


def _planar_states(values: gtsam.Values, keys: list[int]) -> tuple[Array, Array]:
    poses = (values.atPose2(key) for key in keys)
    x, o = (np.array([[pose.x(), pose.y(), pose.theta()]]) for pose in poses)
    return x, o
