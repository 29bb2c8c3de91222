"""Direction of gravity, from an inertial sensor: an attitude factor on the robot in space."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import gtsam
import numpy as np

from semantic_slam.geometry import se3, so3
from semantic_slam.geometry.arrays import Array, squared_norms
from semantic_slam.inference.models.spatial.detection import across

UP = np.array([0.0, 0.0, 1.0])
"""The vertical in map."""
MODE_ITERATIONS = 5
"""Linearisations on the way to a mode; each leaves an error of the order of the square of the one before."""


@dataclass(frozen=True)
class Levelled:
    """A Gaussian over robot and others updated by a gravity measurement; n tangent coordinates, the robot's first."""

    shift: Array  # (n,) of the means
    covariance: Array  # (n, n)
    log_evidence: float  # log density of the measurement, predicted


@dataclass(frozen=True, eq=False)
class Gravity:
    """One measurement of the vertical; it says nothing of yaw and position."""

    up: Array  # (3,) of unit length, along the body's axes
    variance: float  # [rad^2] about each of two axes across it

    @classmethod
    def of(cls, level: Array | None) -> Self | None:
        """From ``Keyframe.level`` (4,)."""
        return None if level is None else cls(level[:3] / np.linalg.norm(level[:3]), float(level[3]))

    @cached_property
    def _aside(self) -> Array:
        """(3, 2) axes of the plane across ``up``."""
        return across(self.up)

    def residual(self, robot: Array) -> tuple[Array, Array]:
        """(..., 2) deviation [rad, first order] of the measured vertical from robots' (..., 7), and its Jacobian."""
        true = so3.matrix(robot[..., 3:])[..., 2, :]  # up along the body's axes
        slopes = np.zeros((*true.shape[:-1], 2, 6))
        slopes[..., se3.ROTATION] = self._aside.T @ so3.hat(true)
        return true @ self._aside, slopes

    def log_likelihood(self, robot: Array) -> Array:
        """(...,) log density of the measurement from robots (..., 7)."""
        squared = squared_norms(self.residual(robot)[0]) / self.variance
        return np.asarray(-0.5 * squared - np.log(2.0 * np.pi * self.variance))

    def levels(self, robot: Array, covariance: Array) -> Levelled:
        """The Kalman update of a robot (7,) and whatever is jointly known with it, covariance (n, n)."""
        residual, slopes = self.residual(robot)
        cross = covariance[:, :6] @ slopes.T
        innovation = slopes @ cross[:6] + self.variance * np.eye(2)
        gain = np.linalg.solve(innovation, cross.T)
        squared = residual @ np.linalg.solve(innovation, residual)
        return Levelled(
            shift=-residual @ gain,
            covariance=covariance - cross @ gain,
            log_evidence=float(-np.log(2.0 * np.pi) - 0.5 * (np.linalg.slogdet(innovation)[1] + squared)),
        )

    def at_mode(self, robot: Array, covariance: Array) -> Levelled:
        """The update as of :meth:`levels`, linearised at its result: the mode, and Laplace's approximation there.

        The covariance remains in the tangent space at the prior mean.
        """
        shift: Array = np.zeros(len(covariance))
        for _ in range(MODE_ITERATIONS):
            here = shift[:6]
            residual, slopes = self.residual(se3.retract(robot, here))
            slopes = slopes @ se3.right_jacobian(here)
            cross = covariance[:, :6] @ slopes.T
            innovation = slopes @ cross[:6] + self.variance * np.eye(2)
            weight = np.linalg.solve(innovation, slopes @ here - residual)
            shift = np.asarray(cross @ weight)
        off = self.residual(se3.retract(robot, shift[:6]))[0]
        squared = off @ off / self.variance + weight @ (innovation - self.variance * np.eye(2)) @ weight
        return Levelled(
            shift=shift,
            covariance=covariance - cross @ np.linalg.solve(innovation, cross.T),
            log_evidence=float(-np.log(2.0 * np.pi) - 0.5 * (np.linalg.slogdet(innovation)[1] + squared)),
        )

    def factor(self, key: int) -> Any:
        """GTSAM factor on a pose."""
        noise = gtsam.noiseModel.Isotropic.Sigma(2, np.sqrt(self.variance))
        return gtsam.AttitudeFactorPose3(key, gtsam.Unit3(UP), noise, gtsam.Unit3(self.up))
