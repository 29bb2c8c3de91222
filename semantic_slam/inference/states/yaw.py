"""Yaw of an upright object in space, as its views tell it, beside a Gaussian that does not know it."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry import se3, so3
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import planar_from_pose_vector, wrap_angle

YAW = 2
"""Tangent coordinate of a turn about an upright object's own z."""


@dataclass(frozen=True)
class Yaw:
    """Mean and variance of an object's rotation about the vertical, over all classes."""

    mean_rad: float
    variance: float

    @classmethod
    def of(cls, probabilities: Array) -> "Yaw":
        """The wrapped normal with the moments of (H,) probabilities, cell 0 at yaw 0 (Mardia and Jupp, 2000, 3.5)."""
        angles = 2.0 * np.pi / len(probabilities) * np.arange(len(probabilities))
        return cls.of_moment(complex(probabilities @ np.exp(1j * angles)))

    @classmethod
    def of_moment(cls, moment: complex) -> "Yaw":
        """The wrapped normal whose E[exp(i yaw)] is ``moment``."""
        return cls(float(np.angle(moment)), float(-2.0 * np.log(max(min(abs(moment), 1.0), 1e-300))))

    def applied(self, pose: Array, covariance: Array) -> tuple[Array, Array]:
        """A pose (7,) and its covariance (6, 6) in the tangent space there, turned; as they are if they know more."""
        if self.variance >= covariance[YAW, YAW]:
            return pose, covariance
        turn = np.zeros(3)
        turn[YAW] = wrap_angle(self.mean_rad - planar_from_pose_vector(pose)[2])
        turned = np.append(pose[:3], so3.normalised(so3.product(so3.exp(turn), pose[3:])))
        spread = se3.covariance_at_pose(turned, se3.covariance_along_parent(pose, covariance))
        spread[YAW], spread[:, YAW] = 0.0, 0.0
        spread[YAW, YAW] = self.variance
        return turned, spread
