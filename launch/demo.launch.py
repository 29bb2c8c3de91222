"""Replays a bag through the whole chain.

    ros2 launch semantic_slam demo.launch.py bag:=bags/aliased_room record:=out/belief

The nodes and their parameters are those of ``make demo``: semantic_slam/ros/node_set.py.
"""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from semantic_slam.ros.node_set import node_set
from semantic_slam.ros.transport import is_installed


def end_of(name, last):
    """What happens when the node ``name`` ends: the last of the chain, or any that died, ends the launch.

    Without one of them the others would wait for ever.
    """

    def on_exit(event, context):
        if event.returncode:
            return [Shutdown(reason=f"{name} has died with exit code {event.returncode}")]
        return [Shutdown(reason=f"{name} has ended")] if name == last else []

    return on_exit


def start_nodes(context):
    """Actions of all nodes, once the arguments' values are known."""
    bag, config, backends, rate, record, overwrite = (
        LaunchConfiguration(name).perform(context)
        for name in ("bag", "config", "backends", "rate", "record", "overwrite")
    )
    has_tf2 = is_installed("tf2_msgs/msg/TFMessage")
    may_replace = overwrite.lower() == "true"
    specs = node_set(
        Path(bag), Path(config), int(backends), float(rate), record, has_tf2=has_tf2, overwrite=may_replace
    )
    # The last of the chain to be done ends the launch.
    last = "bag_recorder" if record else "bag_player"
    return [
        Node(
            package="semantic_slam",
            executable=spec.executable,
            name=spec.name,
            parameters=[spec.parameters],
            output="screen",
            emulate_tty=True,
            on_exit=end_of(spec.name, last),
        )
        for spec in specs
    ]


def generate_launch_description():
    default_config = Path(get_package_share_directory("semantic_slam")) / "config" / "default.yaml"
    return LaunchDescription(
        [
            DeclareLaunchArgument("bag", description="rosbag2 folder, .mcap or .db3 to replay"),
            DeclareLaunchArgument("config", default_value=str(default_config), description="parameter file"),
            DeclareLaunchArgument("backends", default_value="2", description="number of backend nodes"),
            DeclareLaunchArgument("rate", default_value="0.0", description="0: lossless lock-step, 1: real time"),
            DeclareLaunchArgument("record", default_value="", description="belief bag to write; empty: none"),
            DeclareLaunchArgument("overwrite", default_value="false", description="true: replace an old belief bag"),
            OpaqueFunction(function=start_nodes),
        ]
    )
