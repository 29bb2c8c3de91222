"""Odometry from TF: the transform odom -> base_link, directly or over fixed transforms of /tf_static."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.pose import rotation_matrix
from semantic_slam.messages.standard import OdometryEstimate, stamp_ns

Array = NDArray[np.float64]
IDENTITY = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])


class TfOdometry:
    """Picks T_odom_base out of TF messages; fixed transforms have to be given first."""

    def __init__(self, odom_frame: str, base_frame: str) -> None:
        self.odom_frame = _plain(odom_frame)
        self.base_frame = _plain(base_frame)
        self.seen: set[tuple[str, str]] = set()  # (parent, child) of the moving transforms
        self._fixed: dict[str, tuple[str, Array]] = {}  # child -> (parent, T_parent_child)

    def add_fixed(self, message: Any) -> None:
        """Remember the transforms of a /tf_static message."""
        for row in message.transforms:
            self._fixed[_plain(row.child_frame_id)] = (_plain(row.header.frame_id), transform_vector(row.transform))

    def read(self, message: Any) -> list[OdometryEstimate]:
        """The odometry in one /tf message; empty when it is about other frames."""
        T_child_base_of = self._ancestors_of_base()
        estimates = []
        for row in message.transforms:
            parent, child = _plain(row.header.frame_id), _plain(row.child_frame_id)
            self.seen.add((parent, child))
            if parent == self.odom_frame and child in T_child_base_of:
                T_odom_base = compose(transform_vector(row.transform), T_child_base_of[child])
                stamp = stamp_ns(row.header.stamp)
                estimates.append(OdometryEstimate(stamp, parent, self.base_frame, T_odom_base, np.zeros((6, 6))))
        return estimates

    def _ancestors_of_base(self) -> dict[str, Array]:
        """T_ancestor_base of the body's frame and of every frame fixed above it."""
        frame, T_frame_base = self.base_frame, IDENTITY
        found = {frame: T_frame_base}
        while frame in self._fixed and self._fixed[frame][0] not in found:
            frame, T_parent_child = self._fixed[frame]
            T_frame_base = compose(T_parent_child, T_frame_base)
            found[frame] = T_frame_base
        return found


def transform_vector(transform: Any) -> Array:
    """(7,) pose vector of a geometry_msgs/Transform."""
    t, q = transform.translation, transform.rotation
    return np.array([t.x, t.y, t.z, q.x, q.y, q.z, q.w], dtype=np.float64)


def compose(T_a_b: Array, T_b_c: Array) -> Array:
    """(7,) pose vector T_a_c; translation in metres, Hamilton product of the quaternions."""
    x1, y1, z1, w1 = T_a_b[3:]
    x2, y2, z2, w2 = T_b_c[3:]
    quaternion = [
        w1 * x2 + x1 * w2 + y1 * z2 - z1 * y2,
        w1 * y2 - x1 * z2 + y1 * w2 + z1 * x2,
        w1 * z2 + x1 * y2 - y1 * x2 + z1 * w2,
        w1 * w2 - x1 * x2 - y1 * y2 - z1 * z2,
    ]
    return np.concatenate([T_a_b[:3] + rotation_matrix(T_a_b[3:]) @ T_b_c[:3], quaternion])


def _plain(frame: str) -> str:
    """ROS 1 wrote frames with a leading slash; some bags still have it."""
    return frame.lstrip("/")
