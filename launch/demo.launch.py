"""Launch file that replays a bag through all nodes.

    ros2 launch semantic_slam demo.launch.py bag:=bags/aliased_room record:=out/belief

The nodes and their parameters are those of ``make demo``, from semantic_slam/ros/launching/node_set.py.
"""

import signal
import time
from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent, LogInfo, OpaqueFunction, Shutdown, TimerAction
from launch.events import matches_action
from launch.events.process import SignalProcess
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from semantic_slam.pipeline.default_configuration import configuration_for
from semantic_slam.ros.launching.node_set import node_set
from semantic_slam.ros.launching.supervisor import Supervisor
from semantic_slam.ros.wire.transport import is_installed


class Nodes:
    """Launch actions of the nodes, with restarts by a :class:`Supervisor` when one of them ends."""

    def __init__(self, specs, last, namespace):
        self._supervisor = Supervisor(specs, last)
        self._namespace = namespace
        self._actions = {}

    def action(self, spec):
        """Launch action of one node."""
        self._actions[spec.name] = Node(
            package="semantic_slam",
            executable=spec.executable,
            name=spec.name,
            namespace=self._namespace,
            parameters=[spec.parameters],
            output="screen",
            emulate_tty=True,
            on_exit=self._end_of(spec.name),
        )
        return self._actions[spec.name]

    def _end_of(self, name):
        def on_exit(event, context):
            if context.is_shutdown:
                return []
            verdict = self._supervisor.ended(name, event.returncode, time.monotonic())
            if verdict.ends_run:
                return [Shutdown(reason=verdict.text)]
            return [
                *([LogInfo(msg=verdict.text)] if verdict.text else []),
                *(self._kill(other) for other in verdict.kill if self._is_up(other)),
                *([TimerAction(period=verdict.after_s, actions=[self.action(verdict.again)])] if verdict.again else []),
            ]

        return on_exit

    def _is_up(self, name):
        """Whether a node is running; if not, it is already due for a restart, and the supervisor is told."""
        details = self._actions[name].process_details
        if details is None:
            self._supervisor.is_down(name)
        return details is not None

    def _kill(self, name):
        matcher = matches_action(self._actions[name])
        return EmitEvent(event=SignalProcess(signal_number=signal.SIGKILL, process_matcher=matcher))


def start_nodes(context):
    """Actions of all nodes, made once the values of the launch arguments are known."""
    names = ("bag", "config", "backends", "rate", "record", "overwrite", "journal", "resume", "autostart", "namespace")
    bag, config, backends, rate, record, overwrite, journal, resume, autostart, namespace = (
        LaunchConfiguration(name).perform(context) for name in names
    )
    specs = node_set(
        Path(bag),
        Path(config) if config else configuration_for(Path(bag)),
        int(backends),
        float(rate),
        record,
        has_tf2=is_installed("tf2_msgs/msg/TFMessage"),
        overwrite=overwrite.lower() == "true",
        journal=journal or (f"{record}.journal" if record else ""),
        resume=resume.lower() == "true",
        autostart=autostart.lower() == "true",
    )
    # The node that finishes last ends the launch.
    nodes = Nodes(specs, "bag_recorder" if record else "bag_player", namespace)
    return [nodes.action(spec) for spec in specs]


def generate_launch_description():
    return LaunchDescription(
        [
            DeclareLaunchArgument("bag", description="rosbag2 folder, .mcap or .db3 to replay"),
            DeclareLaunchArgument(
                "config",
                default_value="",
                description="parameter file; empty: config/default.yaml, or detector.yaml where labels ask for it",
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
