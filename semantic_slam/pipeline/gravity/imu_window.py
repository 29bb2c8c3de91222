"""Time window of IMU readings before a keyframe, with the sensor's motion by odometry."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry import se3, so3
from semantic_slam.geometry.arrays import Array
from semantic_slam.messages.standard import NANOSECONDS
from semantic_slam.pipeline.odometry.odometry_path import OdometryPath

LONGEST_GAP = 0.25
"""Longest part of a window, as a fraction, without a message or without odometry."""


@dataclass(frozen=True)
class ImuWindow:
    """Time window before a keyframe in which IMU readings are used."""

    stamp_ns: int  # of the keyframe
    length_ns: int
    T_body_imu: Array  # (7,)
    path: OdometryPath

    def carried(self, stamp_ns: int, direction: Array) -> Array:
        """(3,) direction in the body frame at the keyframe, from the sensor frame at an earlier stamp."""
        return self.in_body(self.along_odom(np.array([stamp_ns]), direction[None])[0])

    def in_body(self, direction: Array) -> Array:
        """(3,) direction in the body frame at the keyframe, from the odom frame."""
        (pose,) = self.path.at(np.array([self.stamp_ns]))
        return so3.rotated(so3.inverse(pose[3:]), direction)

    @property
    def _instants_ns(self) -> NDArray[np.int64]:
        """(3,) stamps of the start, the middle and the end of the window."""
        return self.stamp_ns - np.array([self.length_ns, self.length_ns // 2, 0])

    def has_gap(self, stamps_ns: NDArray[np.int64]) -> bool:
        """Whether readings at stamps (M,), or odometry, leave a gap in the window."""
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
        """(3,) mean along the axes of odom of accelerations (M, 3) in the sensor frame, with triangular weights."""
        _, middle, _ = self._instants_ns
        weights = (1.0 - np.abs(stamps_ns - middle) / (0.5 * self.length_ns)) * np.gradient(stamps_ns.astype(float))
        return np.asarray(weights @ self.along_odom(stamps_ns, accelerations) / weights.sum())

    def along_odom(self, stamps_ns: NDArray[np.int64], directions: Array) -> Array:
        """(M, 3) directions along the axes of odom, from the sensor frame at the stamps (M,)."""
        return so3.rotated(so3.product(self.path.at(stamps_ns)[:, 3:], self.T_body_imu[3:]), directions)

    def known_acceleration(self) -> Array:
        """(3,) :meth:`own_acceleration`; zeros where odometry begins within the window."""
        return np.zeros(3) if self.path.stamps_ns[0] > self._instants_ns[0] else self.own_acceleration()

    def own_acceleration(self) -> Array:
        """(3,) mean acceleration [m/s^2] of the sensor by odometry, along the axes of odom, with the same weights."""
        first, middle, last = se3.compose(self.path.at(self._instants_ns), self.T_body_imu)[:, :3]
        return np.asarray((first - 2.0 * middle + last) / (0.5 * self.length_ns / NANOSECONDS) ** 2)
