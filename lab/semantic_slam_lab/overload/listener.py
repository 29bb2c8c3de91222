"""What live nodes say while they are sent more than they can use."""

import time

from rclpy.node import Node

from semantic_slam.messages import topics
from semantic_slam.messages.typestore import deserialize
from semantic_slam.ros.replay.resumption import header_stamp_ns
from semantic_slam.ros.wire import qos
from semantic_slam.ros.wire.transport import receive

WHOLE = ("came faster", f"no {topics.ODOMETRY} at their stamp")
"""Reasons for which whole frames are dropped."""


class Listener:
    """What the nodes say: the newest keyframe, how late it was, and what was dropped of what was sent."""

    def __init__(self, node: Node) -> None:
        self.keyframe, self.late_s, self._latest_s = -1, 0.0, 0.0
        self._dropped: dict[str, int] = {}
        receive(node, topics.BELIEF, self._note, qos.everything())
        receive(node, topics.DIAGNOSTICS, self._count, qos.everything())

    @property
    def num_dropped(self) -> int:
        """Frames that came faster than they could be used, or without odometry."""
        return sum(self._dropped.values())

    def take_latest_s(self) -> float:
        """By how much the latest of the beliefs since the last call was late; 0 where none came."""
        latest_s, self._latest_s = self._latest_s, 0.0
        return latest_s

    def _note(self, data: bytes) -> None:
        self.keyframe = int(deserialize(data, topics.TYPES[topics.BELIEF]).keyframe)
        self.late_s = time.time() - header_stamp_ns(data) / 1e9
        self._latest_s = max(self._latest_s, self.late_s)

    def _count(self, data: bytes) -> None:
        for status in deserialize(data, topics.TYPES[topics.DIAGNOSTICS]).status:
            told = {f"{status.name} {own.key}": int(own.value) for own in status.values if _is_whole(own.key)}
            self._dropped.update(told)


def _is_whole(reason: str) -> bool:
    return any(own in reason for own in WHOLE)
