"""Inverse-depth-like prior of an object started by a ray alone: a Gaussian over the logarithm of its range.

It is about the camera position as estimated at that time, which stays fixed: across the ray the detection factor itself
places the object, with the camera's uncertainty. A Gaussian over x, y and z would be wrong by metres as soon as the
object is not where it was guessed.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

import gtsam
import numpy as np

from semantic_slam.geometry import se3, so3
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.callback_factor import callback_factor
from semantic_slam.inference.models.spatial.log_range import ANYWHERE, LogRange
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.kinds.state_space import StateSpace

FAR = 2.0
"""Excess of the log range over the prior's mean from which on the secant to that mean stands for the derivative: along
the tangent, steps of Gauss-Newton would lead behind the camera, and ever farther away."""
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
        return cls.of_rays([log_range], ray[None], sensor[None], robot)[0]

    @classmethod
    def of_rays(cls, log_ranges: Sequence[LogRange], rays: Array, sensors: Array, robot: Array) -> "list[RangePrior]":
        """The priors of n objects at once, from ``rays`` (n, 3) that begin at ``sensors`` (n, 3) of a ``robot``."""
        ranges = [own.range_m for own in log_ranges]
        mounted, away = so3.rotated(robot[3:], np.stack([sensors, np.array(ranges)[:, None] * rays]))
        anchors = robot[:3] + mounted
        spreads = [(own.sigma * range_m) ** 2 * np.eye(3) for own, range_m in zip(log_ranges, ranges, strict=True)]
        return list(map(cls, anchors + away, spreads, anchors, sensors, log_ranges))

    def at(self, mean: Array, robot: Array) -> Self:
        """With the camera position of another ``robot`` (7,); the object starts at ``mean`` (s,)."""
        return replace(self, mean=mean, anchor=robot[:3] + so3.rotated(robot[3:], self.sensor))

    def factors(self, space: StateSpace, key: int) -> list[Any]:
        """GTSAM's factors of the prior: one, of the distance along the ray."""
        return [self.factor(space, key)]

    def factor(self, space: StateSpace, key: int) -> Any:
        """GTSAM factor: deviation of the log distance from the anchor, in standard deviations."""

        def error(this: Any, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
            residual, slopes = self.off(space.position(space.state(values, this.keys()[0])))
            if jacobians is not None:
                jacobians[0] = np.asfortranarray(slopes)
            return residual

        return callback_factor(StartedByRay(self, key), [key], 1, error)

    def off(self, place: Array) -> tuple[Array, Array]:
        """(1,) deviation of the log distance of a ``place`` (3,), and its (1, 3) Jacobian, a secant's far away."""
        known, away = self.log_range, place - np.asarray(self.anchor)
        distance = max(math.sqrt(away.dot(away)), LEAST_DISTANCE_M)
        excess = math.log(distance) - known.mean
        steeper = excess / -math.expm1(-excess) if excess > FAR else 1.0
        return np.array([excess / known.sigma]), steeper * away[None] / (known.sigma * distance**2)


@dataclass(frozen=True)
class BodyRangePrior(RangePrior):
    """Range prior of an object with an attitude, which has a Gaussian prior of its own."""

    @classmethod
    def of_body(cls, place: RangePrior, attitude: Array, covariance: Array) -> "BodyRangePrior":
        """From the prior of its ``place``, and an attitude (4,) with its covariance (3, 3) in the tangent space."""
        spread = np.zeros((6, 6))
        spread[se3.ROTATION, se3.ROTATION], spread[se3.TRANSLATION, se3.TRANSLATION] = covariance, place.covariance
        return cls(np.concatenate([place.mean, attitude]), spread, place.anchor, place.sensor, place.log_range)

    def factor(self, space: StateSpace, key: int) -> Any:
        """GTSAM factor: deviation of the log distance from the anchor, then of the attitude, in standard deviations."""
        whiten = np.linalg.inv(np.linalg.cholesky(self.covariance[se3.ROTATION, se3.ROTATION]))
        qx, qy, qz, qw = self.mean[3:].tolist()
        upright = gtsam.Rot3.Quaternion(qw, qx, qy, qz)

        def error(this: Any, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
            pose = values.atPose3(this.keys()[0])
            along, slopes = self.off(pose.translation())
            turned = gtsam.Rot3.Logmap(upright.between(pose.rotation()))
            if jacobians is not None:
                jacobian = np.zeros((4, 6), order="F")
                jacobian[:1, se3.TRANSLATION] = slopes @ pose.rotation().matrix()
                jacobian[1:, se3.ROTATION] = whiten @ gtsam.Rot3.LogmapDerivative(turned)
                jacobians[0] = jacobian
            return np.concatenate([along, whiten @ turned])

        return callback_factor(StartedByRay(self, key), [key], 4, error)


@dataclass(frozen=True)
class StartedByRay:
    """A range prior, and the GTSAM key of its object."""

    prior: RangePrior
    key: int

    @property
    def anchor(self) -> Array:
        """(3,) origin of the ray, in map."""
        return np.asarray(self.prior.anchor)
