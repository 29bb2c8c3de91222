"""Launch file that replays a bag through all nodes.

    ros2 launch semantic_slam demo.launch.py bag:=bags/aliased_room record:=out/belief

The nodes and their parameters are those of ``make demo``, from semantic_slam/ros/launching/node_set.py.
"""

from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration

from semantic_slam.pipeline.default_configuration import configuration_for
from semantic_slam.ros.launching.launch_actions import Nodes
from semantic_slam.ros.launching.node_set import RunOptions, node_set
from semantic_slam.ros.wire.transport import is_installed


def start_nodes(context):
    """Actions of all nodes, made once the values of the launch arguments are known."""
    names = ("bag", "config", "backends", "rate", "record", "overwrite", "journal", "resume", "autostart", "namespace")
    bag, config, backends, rate, record, overwrite, journal, resume, autostart, namespace = (
        LaunchConfiguration(name).perform(context) for name in names
    )
    specs = node_set(
        Path(bag),
        Path(config) if config else configuration_for(Path(bag)),
        float(rate),
        RunOptions(
            backends=int(backends),
            record=record,
            overwrite=overwrite.lower() == "true",
            journal=journal or (f"{record}.journal" if record else ""),
            resume=resume.lower() == "true",
            autostart=autostart.lower() == "true",
        ),
        has_tf2=is_installed("tf2_msgs/msg/TFMessage"),
        has_stereo=is_installed("stereo_msgs/msg/DisparityImage"),
    )
    # The node that finishes last ends the launch.
    return Nodes(specs, namespace, last="bag_recorder" if record else "bag_player").actions()


def generate_launch_description():
    return LaunchDescription(
        [
            DeclareLaunchArgument("bag", description="rosbag2 folder, .mcap or .db3 to replay"),
            DeclareLaunchArgument(
                "config",
                default_value="",
                description="parameter file; empty: config/default.yaml, or detector.yaml or"
                " detector_second_session.yaml where labels and map ask for it",
            ),
            DeclareLaunchArgument("backends", default_value="2", description="number of backend nodes"),
            DeclareLaunchArgument("rate", default_value="0.0", description="0: lossless lock-step, 1: real time"),
            DeclareLaunchArgument("record", default_value="", description="belief bag to write; empty: none"),
            DeclareLaunchArgument("overwrite", default_value="false", description="true: replace an old belief bag"),
            DeclareLaunchArgument(
                "journal", default_value="", description="folder of the manager's journal; empty: RECORD.journal"
            ),
            DeclareLaunchArgument("resume", default_value="false", description="true: go on with a run broken off"),
            DeclareLaunchArgument(
                "autostart", default_value="true", description="false: nodes wait to be configured and activated"
            ),
            DeclareLaunchArgument("namespace", default_value="", description="of all nodes, for one robot of several"),
            OpaqueFunction(function=start_nodes),
        ]
    )
