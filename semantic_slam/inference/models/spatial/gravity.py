"""Which way is up, as something that feels gravity tells it: an attitude factor of the robot in space."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Self

import gtsam
import numpy as np

from semantic_slam.geometry import se3, so3
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.spatial.detection import across

UP = np.array([0.0, 0.0, 1.0])
"""In map."""


@dataclass(frozen=True)
class Levelled:
    """A Gaussian over robot and others after a look at gravity; n numbers, the robot's first, in tangent spaces."""

    shift: Array  # (n,) of the means
    covariance: Array  # (n, n)
    log_evidence: float  # of the look, before it


@dataclass(frozen=True, eq=False)
class Gravity:
    """One look at the direction of up; yaw and place are left as they are."""

    up: Array  # (3,) of unit length, along the body's axes
    variance: float  # [rad^2] about each of two axes across it

    @classmethod
    def of(cls, level: Array | None) -> Self | None:
        """From ``Keyframe.level`` (4,)."""
        return None if level is None else cls(level[:3] / np.linalg.norm(level[:3]), float(level[3]))

    @cached_property
    def _aside(self) -> Array:
        """(3, 2) axes across ``up``."""
        return across(self.up)

    def residual(self, robot: Array) -> tuple[Array, Array]:
        """(2,) how far up is from where a robot (7,) has it [rad, to first order], and its (2, 6) slopes."""
        true = so3.matrix(robot[3:])[2]  # up along the body's axes
        slopes = np.zeros((2, 6))
        slopes[:, se3.ROTATION] = self._aside.T @ so3.hat(true)
        return self._aside.T @ true, slopes

    def levels(self, robot: Array, covariance: Array) -> Levelled:
        """What it tells of a robot (7,) and of what is known together with it, covariance (n, n)."""
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
        """GTSAM's factor on a pose."""
        noise = gtsam.noiseModel.Isotropic.Sigma(2, np.sqrt(self.variance))
        return gtsam.AttitudeFactorPose3(key, gtsam.Unit3(UP), noise, gtsam.Unit3(self.up))
