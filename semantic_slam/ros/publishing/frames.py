"""Names of the REP-105 frames in which the manager publishes."""

from dataclasses import dataclass

from rclpy.node import Node

from semantic_slam.messages.standard import MAP_FRAME
from semantic_slam.ros.node.parameters import declare_fixed


@dataclass(frozen=True)
class Frames:
    """Frame names of beliefs and transforms."""

    map: str = MAP_FRAME
    odom: str = ""  # "": the frame_id of the odometry messages


def declare_frames(node: Node) -> Frames:
    """Declare the parameters ``map_frame`` and ``odom_frame`` and return their values."""
    return Frames(declare_fixed(node, "map_frame", MAP_FRAME), declare_fixed(node, "odom_frame", ""))
