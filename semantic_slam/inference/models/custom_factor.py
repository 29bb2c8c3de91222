"""GTSAM factors of detections with a Python callback, where GTSAM has no built-in factor of that measurement."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import gtsam
import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.callback_factor import callback_factor
from semantic_slam.inference.models.observation import Linearisation
from semantic_slam.inference.states.spaces import Spaces


@dataclass(frozen=True)
class Sighting:
    """A detection of a landmark from a robot pose, with their GTSAM keys."""

    detection: Any
    keys: tuple[int, int]


def custom_factor(
    spaces: Spaces, linearise: Callable[[Array, Array], Linearisation], sighting: Sighting, rows: slice, size: int
) -> Any:
    """Factor on robot and landmark of ``size`` ``rows`` of a whitened residual."""

    def error(this: Any, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
        robot, target = this.keys()
        part = linearise(spaces.robot.state(values, robot)[None], spaces.landmark.state(values, target)[None])
        if jacobians is not None:
            jacobians[0] = np.asfortranarray(part.jacobian_robot[0, rows])
            jacobians[1] = np.asfortranarray(part.jacobian_object[0, rows])
        return np.asarray(part.residual[0, rows])

    return callback_factor(sighting, sighting.keys, size, error)
