"""Inverse-depth-like prior of an object started by a ray alone: a Gaussian over the logarithm of its range.

It is about the camera position as estimated at that time, which stays fixed: across the ray the detection factor itself
places the object, with the camera's uncertainty. A Gaussian over x, y and z would be wrong by metres as soon as the
object is not where it was guessed.
"""

import math
from dataclasses import dataclass, field
from typing import Any

import gtsam
import numpy as np

from semantic_slam.geometry import so3
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.callback_factor import callback_factor
from semantic_slam.inference.models.spatial.log_range import ANYWHERE, LogRange
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.kinds.state_space import StateSpace

LEAST_DISTANCE_M = 1e-3
"""Distance to the camera below which the derivative of the logarithm is meaningless."""


@dataclass(frozen=True)
class RangePrior(GaussianPrior):
    """Range prior; mean and covariance are those for the small problems, in which only the range is constrained."""

    sensor: Array = field(default_factory=lambda: np.zeros(3))  # (3,) the camera in the body frame
    log_range: LogRange = ANYWHERE

    @classmethod
    def of(cls, log_range: LogRange, ray: Array, sensor: Array, robot: Array) -> "RangePrior":
        """From a ``ray`` (3,) that begins at the ``sensor`` (3,) of a ``robot`` (7,)."""
        mounted, away = so3.rotated(robot[3:], np.stack([sensor, log_range.range_m * ray]))
        anchor = robot[:3] + mounted
        place = anchor + away
        spread = (log_range.sigma * log_range.range_m) ** 2 * np.eye(3)
        return cls(place, spread, anchor, sensor, log_range)

    def at(self, mean: Array, robot: Array) -> "RangePrior":
        """With the camera position of another ``robot`` (7,); the object starts at ``mean`` (3,)."""
        anchor = robot[:3] + so3.rotated(robot[3:], self.sensor)
        return RangePrior(mean, self.covariance, anchor, self.sensor, self.log_range)

    def factor(self, space: StateSpace, key: int) -> Any:
        """GTSAM factor: deviation of the log distance from the anchor, in standard deviations."""
        known, anchor = self.log_range, np.asarray(self.anchor)

        def error(this: Any, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
            away = space.position(space.state(values, this.keys()[0])) - anchor
            distance = max(math.sqrt(away.dot(away)), LEAST_DISTANCE_M)
            if jacobians is not None:
                jacobians[0] = np.asfortranarray(away[None] / (known.sigma * distance**2))
            return np.array([(np.log(distance) - known.mean) / known.sigma])

        return callback_factor(StartedByRay(self, key), [key], 1, error)


@dataclass(frozen=True)
class StartedByRay:
    """A range prior, and the GTSAM key of its object."""

    prior: RangePrior
    key: int

    @property
    def anchor(self) -> Array:
        """(3,) origin of the ray, in map."""
        return np.asarray(self.prior.anchor)
