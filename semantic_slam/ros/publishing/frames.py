"""Names of the frames of REP-105 in which the manager publishes."""

from dataclasses import dataclass

from rclpy.node import Node

from semantic_slam.ros.node.parameters import declare_fixed

MAP = "map"


@dataclass(frozen=True)
class Frames:
    """Frames of beliefs and transforms."""

    map: str = MAP
    odom: str = ""  # "": as the headers of the odometry name it
    broadcasts_odom: bool = False  # odom -> base, too, for a robot on which nobody else does


def declare_frames(node: Node) -> Frames:
    """Frames as the parameters ``map_frame``, ``odom_frame`` and ``broadcast_odom`` name them."""
    return Frames(
        declare_fixed(node, "map_frame", MAP),
        declare_fixed(node, "odom_frame", ""),
        declare_fixed(node, "broadcast_odom", False),
    )
