"""The robot's path: its newest poses on a topic, all of them from the service ``~/get_path``."""

from typing import Any

import numpy as np
from rclpy.node import Node
from semantic_slam_msgs.srv import GetPath

from semantic_slam.geometry.arrays import Array
from semantic_slam.messages import topics
from semantic_slam.messages.standard import NANOSECONDS, PoseEstimate
from semantic_slam.messages.typestore import serialize
from semantic_slam.ros.publishing.views import MAP, path_view
from semantic_slam.ros.wire import qos
from semantic_slam.ros.wire.transport import Outlet, private_name, ros_type

NEWEST = 1000
"""Poses that a message holds: each is sent again with every keyframe that follows."""


class PathPublisher:
    """Remembers the pose estimates of all keyframes."""

    def __init__(self, node: Node) -> None:
        self._outlet = Outlet(node, private_name(topics.PATH), topics.TYPES[topics.PATH], qos.latched())
        self._service = node.create_service(GetPath, "~/get_path", self._answer)
        self._stamps_ns: list[int] = []
        self._poses: list[Array] = []  # (7,)

    def begin(self) -> None:
        """Another run begins."""
        self._stamps_ns, self._poses = [], []

    def publish(self, estimate: PoseEstimate) -> None:
        """The newest poses, with one more."""
        self._stamps_ns.append(estimate.stamp_ns)
        self._poses.append(estimate.pose)
        self._outlet.send(serialize(path_view(self._stamps_ns[-NEWEST:], np.array(self._poses[-NEWEST:]))))

    def wait_for_acknowledgement(self) -> None:
        self._outlet.wait_for_acknowledgement()

    def _answer(self, _: Any, response: Any) -> Any:
        kind = ros_type("geometry_msgs/msg/PoseStamped")
        known = zip(list(self._stamps_ns), list(self._poses), strict=False)  # the worker may be adding one
        response.poses = [_filled(kind(), *own) for own in known]
        return response


def _filled(message: Any, stamp_ns: int, pose: Array) -> Any:
    message.header.frame_id = MAP
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, NANOSECONDS)
    point, turn = message.pose.position, message.pose.orientation
    point.x, point.y, point.z, turn.x, turn.y, turn.z, turn.w = pose.tolist()
    return message
