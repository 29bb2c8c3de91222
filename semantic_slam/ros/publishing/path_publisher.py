"""Publishes the robot's path: the newest poses on a topic, all of them by the service ``~/get_path``."""

from array import array
from typing import Any, ClassVar

import numpy as np
from rclpy.node import Node
from semantic_slam_msgs.srv import GetPath

from semantic_slam.geometry.arrays import Array
from semantic_slam.messages import topics
from semantic_slam.messages.standard import NANOSECONDS, PoseEstimate
from semantic_slam.messages.typestore import serialize
from semantic_slam.pipeline.plain_views import NEWEST, path_view
from semantic_slam.ros.wire import qos
from semantic_slam.ros.wire.transport import Outlet, private_name, ros_type

SIZE = 7
"""Numbers per pose."""


class PathPublisher:
    """Keeps the pose estimates of all keyframes and publishes them as a path."""

    STATE: ClassVar[tuple[str, ...]] = ("_known",)

    def __init__(self, node: Node, frame: str) -> None:
        self._frame = frame
        name, kind = private_name(topics.PATH), topics.TYPES[topics.PATH]
        self._outlet = Outlet(node, name, kind, qos.latched(), may_be_overridden=True)
        self._service = node.create_service(GetPath, "~/get_path", self._answer)
        self.begin()

    def begin(self) -> None:
        """Clear the path for another run."""
        self._known = array("q"), array("d")  # stamps and poses, in one tuple because another thread reads both

    def publish(self, estimate: PoseEstimate) -> None:
        """Append a pose estimate and publish the newest poses."""
        stamps_ns, poses = self._known
        stamps_ns.append(estimate.stamp_ns)
        poses.extend(estimate.pose.tolist())
        newest = _rows(poses[-NEWEST * SIZE :])
        self._outlet.send(serialize(path_view(stamps_ns[-NEWEST:].tolist(), newest, self._frame)))

    def wait_for_acknowledgement(self) -> None:
        self._outlet.wait_for_acknowledgement()

    def _answer(self, _: Any, response: Any) -> Any:
        kind = ros_type("geometry_msgs/msg/PoseStamped")
        stamps_ns, numbers = self._known
        poses = _rows(numbers[: SIZE * len(stamps_ns)])  # the worker thread may be appending one
        known = zip(stamps_ns[: len(poses)].tolist(), poses, strict=True)
        response.poses = [_filled(kind(), self._frame, *own) for own in known]
        return response


def _rows(numbers: "array[float]") -> Array:
    """(K, 7) poses from a flat array; an incomplete last one is left out."""
    whole = len(numbers) // SIZE
    return np.array(numbers[: whole * SIZE]).reshape(whole, SIZE)


def _filled(message: Any, frame: str, stamp_ns: int, pose: Array) -> Any:
    message.header.frame_id = frame
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, NANOSECONDS)
    point, turn = message.pose.position, message.pose.orientation
    point.x, point.y, point.z, turn.x, turn.y, turn.z, turn.w = pose.tolist()
    return message
