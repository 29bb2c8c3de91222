"""Conversion of headers, stamps and poses of the standard message packages."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from semantic_slam.errors import MessageError
from semantic_slam.geometry.arrays import Array
from semantic_slam.messages.typestore import message_class

NANOSECONDS = 1_000_000_000
MAP_FRAME = "map"
"""Name of the frame of beliefs, start poses and ground truth in bags and, unless set otherwise, in a running suite."""
FARTHEST_M = 1e9
"""Largest plausible distance [m] from an origin; larger numbers are faults."""


@dataclass(frozen=True)
class PoseEstimate:
    """A pose with covariance in ``frame_id`` (geometry_msgs/PoseWithCovarianceStamped)."""

    stamp_ns: int
    frame_id: str
    pose: Array  # (7,) x y z [m] qx qy qz qw
    covariance: Array  # (6, 6) x y z rx ry rz


@dataclass(frozen=True)
class OdometryEstimate:
    """Pose of ``child_frame_id`` in ``frame_id`` (nav_msgs/Odometry without its twist, which is left at zero)."""

    stamp_ns: int
    frame_id: str
    child_frame_id: str
    pose: Array  # (7,) x y z [m] qx qy qz qw
    covariance: Array  # (6, 6) x y z rx ry rz


def time_message(stamp_ns: int) -> Any:
    """builtin_interfaces/Time."""
    seconds, nanoseconds = divmod(int(stamp_ns), NANOSECONDS)
    return message_class("builtin_interfaces/msg/Time")(sec=seconds, nanosec=nanoseconds)


def stamp_ns(time: Any) -> int:
    """Nanoseconds of a builtin_interfaces/Time."""
    return int(time.sec) * NANOSECONDS + int(time.nanosec)


def header_message(stamp: int, frame_id: str) -> Any:
    """std_msgs/Header; ``stamp`` in nanoseconds."""
    return message_class("std_msgs/msg/Header")(stamp=time_message(stamp), frame_id=str(frame_id))


def header_stamp_ns(message: Any) -> int:
    """Stamp of a message with a header, nanoseconds."""
    return stamp_ns(message.header.stamp)


def pose_message(pose: Array) -> Any:
    """geometry_msgs/Pose from a (7,) pose vector."""
    x, y, z, qx, qy, qz, qw = (float(value) for value in pose)
    point = message_class("geometry_msgs/msg/Point")(x=x, y=y, z=z)
    quaternion = message_class("geometry_msgs/msg/Quaternion")(x=qx, y=qy, z=qz, w=qw)
    return message_class("geometry_msgs/msg/Pose")(position=point, orientation=quaternion)


def is_pose(pose: Array) -> bool:
    """Whether a (7,) pose vector has a plausible position and a non-zero quaternion."""
    return bool((np.abs(pose[:3]) <= FARTHEST_M).all() and 0.0 < np.linalg.norm(pose[3:]) <= FARTHEST_M)


def pose_vector(pose: Any) -> Array:
    """(7,) pose vector of a geometry_msgs/Pose."""
    p, q = pose.position, pose.orientation
    return np.array([p.x, p.y, p.z, q.x, q.y, q.z, q.w], dtype=np.float64)


def covariance_pose_message(pose: Array, covariance: Array) -> Any:
    """geometry_msgs/PoseWithCovariance from a (7,) pose vector and a (6, 6) covariance."""
    flat = np.asarray(covariance, dtype=np.float64).reshape(36)
    return message_class("geometry_msgs/msg/PoseWithCovariance")(pose=pose_message(pose), covariance=flat)


def covariance_matrix(message: Any) -> Array:
    """(6, 6) covariance of a geometry_msgs/PoseWithCovariance or TwistWithCovariance. Raises MessageError."""
    flat = np.array(message.covariance, dtype=np.float64)
    if flat.size != 36:
        raise MessageError(f"a covariance has {flat.size} numbers in place of 36; whoever sends it has another message")
    return flat.reshape(6, 6)


def pose_estimate_to_message(value: PoseEstimate) -> Any:
    return message_class("geometry_msgs/msg/PoseWithCovarianceStamped")(
        header=header_message(value.stamp_ns, value.frame_id),
        pose=covariance_pose_message(value.pose, value.covariance),
    )


def pose_estimate_from_message(message: Any) -> PoseEstimate:
    return PoseEstimate(
        stamp_ns=header_stamp_ns(message),
        frame_id=message.header.frame_id,
        pose=pose_vector(message.pose.pose),
        covariance=covariance_matrix(message.pose),
    )


def odometry_to_message(value: OdometryEstimate) -> Any:
    vector = message_class("geometry_msgs/msg/Vector3")
    twist = message_class("geometry_msgs/msg/Twist")(
        linear=vector(x=0.0, y=0.0, z=0.0), angular=vector(x=0.0, y=0.0, z=0.0)
    )
    return message_class("nav_msgs/msg/Odometry")(
        header=header_message(value.stamp_ns, value.frame_id),
        child_frame_id=str(value.child_frame_id),
        pose=covariance_pose_message(value.pose, value.covariance),
        twist=message_class("geometry_msgs/msg/TwistWithCovariance")(twist=twist, covariance=np.zeros(36)),
    )


def odometry_from_message(message: Any) -> OdometryEstimate:
    return OdometryEstimate(
        stamp_ns=header_stamp_ns(message),
        frame_id=message.header.frame_id,
        child_frame_id=message.child_frame_id,
        pose=pose_vector(message.pose.pose),
        covariance=covariance_matrix(message.pose),
    )
