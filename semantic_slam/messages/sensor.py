"""Odometry and static transforms from sensor messages."""

from typing import Any, ClassVar

import numpy as np

from semantic_slam.errors import InputError, MessageError
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.transform import compose, inverse
from semantic_slam.inference.inputs.keyframe import OdometrySample
from semantic_slam.messages.standard import NANOSECONDS, header_stamp_ns, is_pose, pose_vector
from semantic_slam.reasons import LONGEST_NAME

IDENTITY = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])


def odometry_sample(message: Any, topic: str) -> OdometrySample:
    """Pose of a nav_msgs/Odometry; raises MessageError that names the stamp when it is not finite.

    A zero covariance counts as not provided.
    """
    stamp, pose = header_stamp_ns(message), pose_vector(message.pose.pose)
    if not is_pose(pose):
        raise MessageError(f"{topic}: the pose at {stamp / NANOSECONDS:.3f} s is not a pose; correct the odometry")
    return OdometrySample(stamp, pose, _stated_covariance(message.pose))


def _stated_covariance(message: Any) -> Array | None:
    """(6, 6) covariance of a geometry_msgs/PoseWithCovariance; None where it is not a usable one."""
    flat = np.asarray(message.covariance, dtype=np.float64)
    return flat.reshape(6, 6) if flat.size == 36 and flat.any() and np.isfinite(flat).all() else None


def transform_vector(transform: Any) -> Array:
    """(7,) pose vector of a geometry_msgs/Transform."""
    t, q = transform.translation, transform.rotation
    return np.array([t.x, t.y, t.z, q.x, q.y, q.z, q.w], dtype=np.float64)


class TransformTree:
    """Static transforms between frames, from /tf_static."""

    STATE: ClassVar[tuple[str, ...]] = ("_parents",)

    def __init__(self) -> None:
        self._parents: dict[str, tuple[str, Array]] = {}  # child -> (parent, T_parent_child)

    def add(self, message: Any) -> None:
        """Add the transforms of a tf2_msgs/TFMessage; a later transform of a child frame replaces an earlier one."""
        for item in message.transforms:
            parent = plain_frame(item.header.frame_id)
            self._parents[plain_frame(item.child_frame_id)] = (parent, transform_vector(item.transform))

    @property
    def is_known(self) -> bool:
        """Whether the tree has any transform."""
        return bool(self._parents)

    @property
    def frames(self) -> list[str]:
        """Names of all frames, sorted."""
        return sorted({*self._parents, *(parent for parent, _ in self._parents.values())})

    def copy(self) -> "TransformTree":
        """A tree of its own with the transforms added so far."""
        other = TransformTree()
        other._parents = dict(self._parents)
        return other

    def connects(self, target: str, source: str) -> bool:
        """Whether the transforms connect two frames."""
        return bool(self._ancestors(plain_frame(target)).keys() & self._ancestors(plain_frame(source)).keys())

    def lookup(self, target: str, source: str) -> Array:
        """T_target_source along the tree. Raises InputError that names the frames when they are not connected."""
        to_target, to_source = self._ancestors(plain_frame(target)), self._ancestors(plain_frame(source))
        for frame, T_frame_source in to_source.items():
            if frame in to_target:
                return compose(inverse(to_target[frame]), T_frame_source)
        link = f"from {target[:LONGEST_NAME]} to {source[:LONGEST_NAME]}"
        raise InputError(f"no static transforms lead {link}; publish /tf_static or set perception.extrinsics")

    def _ancestors(self, frame: str) -> dict[str, Array]:
        """T_ancestor_frame of the frame itself and of every frame above it, nearest first."""
        found, T_ancestor_frame = {frame: IDENTITY}, IDENTITY
        while frame in self._parents and self._parents[frame][0] not in found:
            frame, T_parent_child = self._parents[frame]
            T_ancestor_frame = compose(T_parent_child, T_ancestor_frame)
            found[frame] = T_ancestor_frame
        return found


def plain_frame(frame_id: str) -> str:
    """Frame id without the leading slash that ROS 1 wrote."""
    return frame_id.lstrip("/")


def sensor_pose(
    extrinsics: tuple[float, ...],
    base_frame: str,
    tree: TransformTree,
    frame_id: str,
    parameter: str = "perception.extrinsics",
) -> Array:
    """(7,) T_base_sensor: the configured extrinsics if there are any, else from the tree. Raises InputError."""
    if not extrinsics:
        return tree.lookup(base_frame, frame_id)
    pose = np.array(extrinsics, dtype=np.float64)
    if pose.shape != (7,) or not np.isfinite(pose).all():
        raise InputError(f"{parameter} must be 7 numbers: x y z of the sensor and its quaternion qx qy qz qw")
    if not np.linalg.norm(pose[3:]) > 0.0:
        raise InputError(f"{parameter}: its quaternion is zero; give qx qy qz qw, 0 0 0 1 for axes like the body's")
    return pose
