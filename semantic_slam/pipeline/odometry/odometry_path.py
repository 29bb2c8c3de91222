"""Odometry poses over a short time before a keyframe, with interpolation."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry import se3, so3
from semantic_slam.geometry.arrays import Array
from semantic_slam.pipeline.odometry.motion import OdometryPoint


@dataclass(frozen=True)
class OdometryPath:
    """N poses of the body at increasing stamps."""

    stamps_ns: NDArray[np.int64]  # (N,)
    poses: Array  # (N, 7) T_odom_body

    @classmethod
    def of(cls, points: Sequence[OdometryPoint]) -> "OdometryPath":
        """Path through points in stamp order."""
        stamps = np.array([point.stamp_ns for point in points], dtype=np.int64)
        return cls(stamps, se3.wrapped(np.array([point.pose for point in points])))

    def at(self, stamps_ns: NDArray[np.int64]) -> Array:
        """(M, 7) poses at instants (M,), interpolated at constant velocity; outside the path its end poses."""
        after = np.minimum(np.searchsorted(self.stamps_ns, stamps_ns), len(self.stamps_ns) - 1)
        before = np.maximum(after - 1, 0)
        step = np.maximum(self.stamps_ns[after] - self.stamps_ns[before], 1)
        share = np.clip((stamps_ns - self.stamps_ns[before]) / step, 0.0, 1.0)[:, None]
        first, second = self.poses[before], self.poses[after]
        turn = so3.log(so3.product(so3.inverse(first[:, 3:]), second[:, 3:]))
        turned = so3.product(first[:, 3:], so3.exp(share * turn))
        return np.concatenate([(1.0 - share) * first[:, :3] + share * second[:, :3], turned], axis=1)
