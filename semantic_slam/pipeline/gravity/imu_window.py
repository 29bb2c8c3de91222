"""The time before a keyframe in which an inertial sensor is listened to, and how odometry has it move meanwhile."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry import se3, so3
from semantic_slam.geometry.arrays import Array
from semantic_slam.messages.standard import NANOSECONDS
from semantic_slam.pipeline.odometry.odometry_path import OdometryPath

LONGEST_GAP = 0.25
"""Share of a window that may pass without a message, or without odometry."""


@dataclass(frozen=True)
class ImuWindow:
    """The time before a keyframe in which a sensor is listened to."""

    stamp_ns: int  # of the keyframe
    length_ns: int
    T_body_imu: Array  # (7,)
    path: OdometryPath

    def carried(self, stamp_ns: int, direction: Array) -> Array:
        """(3,) along the body's axes at the keyframe, from those of the sensor a little before."""
        return self.in_body(self.along_odom(np.array([stamp_ns]), direction[None])[0])

    def in_body(self, direction: Array) -> Array:
        """(3,) along the body's axes at the keyframe, from those of odom."""
        (pose,) = self.path.at(np.array([self.stamp_ns]))
        return so3.rotated(so3.inverse(pose[3:]), direction)

    @property
    def _instants_ns(self) -> NDArray[np.int64]:
        """(3,) start, middle and end."""
        return self.stamp_ns - np.array([self.length_ns, self.length_ns // 2, 0])

    def has_gap(self, stamps_ns: NDArray[np.int64]) -> bool:
        """Whether readings (M,), or odometry, do not cover it."""
        start, _, end = self._instants_ns
        longest_ns = LONGEST_GAP * self.length_ns
        inside = self.path.stamps_ns[self.path.stamps_ns > start]
        is_left = self.path.stamps_ns[0] > start
        return bool(
            is_left
            or np.diff([start, *stamps_ns, end]).max() > longest_ns
            or np.diff([start, *inside, end]).max() > longest_ns
        )

    def mean(self, stamps_ns: NDArray[np.int64], accelerations: Array) -> Array:
        """(3,) of accelerations (M, 3) in the sensor that cover it, along the axes of odom, weighed to the middle."""
        _, middle, _ = self._instants_ns
        weights = (1.0 - np.abs(stamps_ns - middle) / (0.5 * self.length_ns)) * np.gradient(stamps_ns.astype(float))
        return np.asarray(weights @ self.along_odom(stamps_ns, accelerations) / weights.sum())

    def along_odom(self, stamps_ns: NDArray[np.int64], directions: Array) -> Array:
        """(M, 3) along the axes of odom, from those of the sensor."""
        return so3.rotated(so3.product(self.path.at(stamps_ns)[:, 3:], self.T_body_imu[3:]), directions)

    def own_acceleration(self) -> Array:
        """(3,) mean acceleration of the sensor by odometry, along its axes and with the same weights."""
        first, middle, last = se3.compose(self.path.at(self._instants_ns), self.T_body_imu)[:, :3]
        return np.asarray((first - 2.0 * middle + last) / (0.5 * self.length_ns / NANOSECONDS) ** 2)
