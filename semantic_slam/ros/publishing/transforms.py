"""Broadcasts the REP-105 transforms at the rate of the odometry."""

from collections import Counter
from collections.abc import Callable
from typing import Any

from semantic_slam.errors import MessageError
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.transform import compose, inverse
from semantic_slam.messages import topics
from semantic_slam.messages.sensor import plain_frame
from semantic_slam.messages.standard import header_stamp_ns, is_pose, pose_vector
from semantic_slam.messages.typestore import deserialize, serialize
from semantic_slam.pipeline.plain_views import transform_view
from semantic_slam.pipeline.stamps.topic_clock import TopicClock
from semantic_slam.ros.publishing.frames import Frames

ODOM, BASE = "odom", "base_link"


class Transforms:
    """Sends map -> odom with every odometry message, from the newest belief; optionally odom -> base, too.

    The worker thread sets map -> odom; the executor's thread receives odometry and sends. Only stamps that the topic's
    clock believes are sent: one far ahead would make every tf2 buffer drop all that follows it.
    """

    def __init__(self, frames: Frames, send: Callable[[bytes], None]) -> None:
        self._frames, self._send = frames, send
        self.broadcasts_odom = False  # also send odom -> base, for a robot on which no other node does
        self.begin()

    def begin(self) -> None:
        """Start another run: map -> odom is unknown until its first belief."""
        self._T_map_odom: Array | None = None
        self._clock: TopicClock[Any] = TopicClock(topics.ODOMETRY, Counter())

    def believe(self, T_map_body: Array, T_odom_body: Array) -> None:
        """Set map -> odom from the body's pose by the belief and by odometry at the same keyframe; both (7,)."""
        self._T_map_odom = compose(T_map_body, inverse(T_odom_body))

    def hear(self, data: bytes) -> None:
        """Take a serialised nav_msgs/Odometry; invalid ones are skipped here and counted by the keyframe assembler."""
        try:
            message = deserialize(data, topics.TYPES[topics.ODOMETRY])
        except MessageError:
            return
        for stamp_ns, believed in self._clock.take(header_stamp_ns(message), message):
            transforms = self._transforms(believed)
            if transforms:
                self._send(serialize(transform_view(stamp_ns, transforms)))

    def _transforms(self, message: Any) -> list[tuple[str, str, Array]]:
        """Transforms to send: parent frame, child frame and (7,) pose of the child in the parent."""
        odom = self._frames.odom or plain_frame(message.header.frame_id) or ODOM
        found = [] if self._T_map_odom is None else [(self._frames.map, odom, self._T_map_odom)]
        pose = pose_vector(message.pose.pose)
        if self.broadcasts_odom and is_pose(pose):
            found.append((odom, plain_frame(message.child_frame_id) or BASE, pose))
        return found
