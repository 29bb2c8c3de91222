"""Launch file that runs all nodes on a live robot and starts again whichever dies.

    ros2 launch semantic_slam robot.launch.py config:=mine.yaml journal:=/var/lib/robot/journal remap:="odom:=/my/odom"

The nodes and their parameters are from semantic_slam/ros/launching/node_set.py, as those of demo.launch.py.
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration

from semantic_slam.ros.launching.launch_actions import Nodes, remappings_of
from semantic_slam.ros.launching.node_set import RunOptions, Sensors, robot_set
from semantic_slam.shipped import configuration_file


def start_nodes(context):
    """Actions of all nodes, made once the values of the launch arguments are known."""

    def text(name):
        return LaunchConfiguration(name).perform(context)

    def is_true(name):
        return text(name).lower() == "true"

    options = RunOptions(
        backends=int(text("backends")),
        record=text("record"),
        overwrite=is_true("overwrite"),
        journal=text("journal"),
        resume=is_true("resume"),
        autostart=is_true("autostart"),
        map_frame=text("map_frame"),
    )
    sensors = Sensors(
        has_images=is_true("has_images"),
        has_depth=is_true("has_depth"),
        has_moving_camera=is_true("has_moving_camera"),
        has_imu=is_true("has_imu"),
        detections_type=text("detections_type"),
        odom_frame=text("odom_frame"),
    )
    specs = robot_set(configuration_file(text("config")), options, sensors=sensors, map_prior=text("map_prior"))
    return Nodes(specs, text("namespace"), remappings=remappings_of(text("remap"))).actions()


def generate_launch_description():
    return LaunchDescription(
        [
            DeclareLaunchArgument("config", description="parameter file, or the name of a shipped one, as detector"),
            DeclareLaunchArgument("journal", description="folder of the manager's journal, from which it goes on"),
            DeclareLaunchArgument("map_prior", default_value="", description="FILE.map or objects.json; empty: none"),
            DeclareLaunchArgument("backends", default_value="2", description="number of backend nodes"),
            DeclareLaunchArgument("record", default_value="", description="belief bag to write; empty: none"),
            DeclareLaunchArgument("overwrite", default_value="false", description="true: replace an old belief bag"),
            DeclareLaunchArgument(
                "resume", default_value="false", description="true: go on with the journal and the bag that are there"
            ),
            DeclareLaunchArgument("remap", default_value="", description="FROM:=TO of input topics, by spaces"),
            DeclareLaunchArgument("has_images", default_value="true", description="false: detections tell places"),
            DeclareLaunchArgument("has_depth", default_value="true", description="false: no depth camera"),
            DeclareLaunchArgument(
                "has_moving_camera", default_value="false", description="true: /tf tells where it is"
            ),
            DeclareLaunchArgument("has_imu", default_value="false", description="true: topic imu measures gravity"),
            DeclareLaunchArgument(
                "detections_type", default_value="", description="type of topic detections; empty: DetectionArray"
            ),
            DeclareLaunchArgument(
                "odom_frame",
                default_value="",
                description="frame of odometry that comes by /tf alone; empty: topic odom",
            ),
            DeclareLaunchArgument(
                "autostart", default_value="true", description="false: nodes wait to be configured and activated"
            ),
            DeclareLaunchArgument("map_frame", default_value="", description="frame of beliefs and TF; empty: map"),
            DeclareLaunchArgument("namespace", default_value="", description="of all nodes, for one robot of several"),
            OpaqueFunction(function=start_nodes),
        ]
    )
