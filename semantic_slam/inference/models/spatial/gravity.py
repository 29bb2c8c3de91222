"""Direction of gravity, from an inertial sensor: an attitude factor on the robot in space."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import gtsam
import numpy as np

from semantic_slam.geometry import se3, so3
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.spatial.detection import across

UP = np.array([0.0, 0.0, 1.0])
"""The vertical in map."""


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
        """(2,) deviation of the measured vertical from a robot's (7,) [rad, first order], and its (2, 6) Jacobian."""
        true = so3.matrix(robot[3:])[2]  # up along the body's axes
        slopes = np.zeros((2, 6))
        slopes[:, se3.ROTATION] = self._aside.T @ so3.hat(true)
        return self._aside.T @ true, slopes

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

    def factor(self, key: int) -> Any:
        """GTSAM factor on a pose."""
        noise = gtsam.noiseModel.Isotropic.Sigma(2, np.sqrt(self.variance))
        return gtsam.AttitudeFactorPose3(key, gtsam.Unit3(UP), noise, gtsam.Unit3(self.up))
