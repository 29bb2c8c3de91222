"""GTSAM factors with a Python callback, where GTSAM has no built-in factor of that measurement.

A CustomFactor cannot be cloned or pickled, but an ISAM2 that holds one can be forked; a component is rebuilt from its
lineage, never from a pickled graph.
"""

from collections.abc import Callable
from typing import Any

import gtsam
import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.linear_factors import unit_noise
from semantic_slam.inference.models.observation import Linearisation
from semantic_slam.inference.states.spaces import Spaces


def custom_factor(
    spaces: Spaces, linearise: Callable[[Array, Array], Linearisation], keys: tuple[int, int], rows: slice, size: int
) -> Any:
    """Factor on robot and landmark of ``size`` ``rows`` of a whitened residual."""

    def error(this: Any, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
        robot, target = this.keys()
        part = linearise(spaces.robot.state(values, robot)[None], spaces.landmark.state(values, target)[None])
        if jacobians is not None:
            jacobians[0] = np.asfortranarray(part.jacobian_robot[0, rows])
            jacobians[1] = np.asfortranarray(part.jacobian_object[0, rows])
        return np.asarray(part.residual[0, rows])

    return gtsam.CustomFactor(unit_noise(size), list(keys), error)
