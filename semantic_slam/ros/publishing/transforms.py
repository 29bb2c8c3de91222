"""Transforms of REP-105 at the rate of the odometry."""

from collections.abc import Callable
from typing import Any

from semantic_slam.errors import MessageError
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.transform import compose, inverse
from semantic_slam.messages import topics
from semantic_slam.messages.sensor import plain_frame
from semantic_slam.messages.standard import header_stamp_ns, is_pose, pose_vector
from semantic_slam.messages.typestore import deserialize, serialize
from semantic_slam.ros.publishing.frames import Frames
from semantic_slam.ros.publishing.views import transform_view

ODOM, BASE = "odom", "base_link"


class Transforms:
    """Sends map -> odom with every message of the odometry: what the newest belief says stays right in between.

    The worker says what that is, the executor's thread hears the odometry and sends.
    """

    def __init__(self, frames: Frames, send: Callable[[bytes], None]) -> None:
        self._frames, self._send = frames, send
        self._T_map_odom: Array | None = None

    def begin(self) -> None:
        """Another run begins: nothing is known before its first belief."""
        self._T_map_odom = None

    def believe(self, T_map_body: Array, T_odom_body: Array) -> None:
        """A belief has the robot there, where odometry has it at ``T_odom_body``; both (7,)."""
        self._T_map_odom = compose(T_map_body, inverse(T_odom_body))

    def hear(self, data: bytes) -> None:
        """A nav_msgs/Odometry; one that cannot be used is counted where motions are made of it."""
        try:
            message = deserialize(data, topics.TYPES[topics.ODOMETRY])
        except MessageError:
            return
        transforms = self._transforms(message)
        if transforms:
            self._send(serialize(transform_view(header_stamp_ns(message), transforms)))

    def _transforms(self, message: Any) -> list[tuple[str, str, Array]]:
        """Parent, child and (7,) pose of each."""
        odom = self._frames.odom or plain_frame(message.header.frame_id) or ODOM
        found = [] if self._T_map_odom is None else [(self._frames.map, odom, self._T_map_odom)]
        pose = pose_vector(message.pose.pose)
        if self._frames.broadcasts_odom and is_pose(pose):
            found.append((odom, plain_frame(message.child_frame_id) or BASE, pose))
        return found
