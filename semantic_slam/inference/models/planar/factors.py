"""GTSAM factors of the planar observation model.

A CustomFactor cannot be cloned or pickled, but an ISAM2 that holds one can be forked; a component is rebuilt
from its lineage, never from a pickled graph.
"""

from collections.abc import Callable
from typing import Any

import gtsam
import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.linear_factors import unit_noise
from semantic_slam.inference.models.observation import Linearisation
from semantic_slam.inference.models.planar_detection import PlanarDetection
from semantic_slam.inference.states.spaces import Spaces


def range_factor(detection: PlanarDetection, keys: tuple[int, int]) -> Any:
    """Built-in bearing-range factor between two poses."""
    return gtsam.BearingRangeFactorPose2(*keys, detection.direction, detection.range_m, detection.noise)


def point_range_factor(detection: PlanarDetection, keys: tuple[int, int]) -> Any:
    """Built-in bearing-range factor between a pose and a point."""
    return gtsam.BearingRangeFactor2D(*keys, detection.direction, detection.range_m, detection.noise)


def bearing_factor(spaces: Spaces, linearise: Callable[[Array, Array], Linearisation], keys: tuple[int, int]) -> Any:
    """Factor on robot and landmark of a measured bearing alone."""

    def error(this: Any, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
        robot, target = this.keys()
        part = linearise(spaces.robot.state(values, robot)[None], spaces.landmark.state(values, target)[None])
        if jacobians is not None:
            jacobians[0] = np.asfortranarray(part.jacobian_robot[0, 1:])
            jacobians[1] = np.asfortranarray(part.jacobian_object[0, 1:])
        return np.asarray(part.residual[0, 1:])

    return gtsam.CustomFactor(unit_noise(1), list(keys), error)
