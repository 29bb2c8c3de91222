"""Node of ``semantic_slam view``, which subscribes without slowing the publishers down.

Streamed topics are read BEST_EFFORT, and shared memory is not used. A stopped process (Ctrl-Z, a closed laptop) with a
RELIABLE reader blocks the publishers until DDS drops it after 20 s; with shared memory it blocks them for good.
"""

import os
import signal
import sys
import threading
from collections.abc import Callable
from typing import Any

import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

from semantic_slam.errors import InputError, MessageError, SemanticSlamError, one_line
from semantic_slam.messages import topics
from semantic_slam.messages.codec import decode
from semantic_slam.messages.typestore import deserialize
from semantic_slam.ros.node.ros_arguments import PLACE_IN_RCL, without_ros_arguments
from semantic_slam.ros.wire import qos
from semantic_slam.ros.wire.transport import is_installed, relative_name, ros_type
from semantic_slam.view.live_run import LiveRun
from semantic_slam.view.server import ViewServer

LOOK_S = 0.5
"""Period [s] of polling for publishers."""
PICTURES = (topics.IMAGE_COMPRESSED, topics.IMAGE)
DEPTH, PICTURES_DEPTH = 200, 10
WITHOUT_SHARED_MEMORY = ("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")
JOIN_S = 1.0
SAY_AGAIN_S = 10.0
OF_THE_MANAGER = (topics.BELIEF, topics.RUN_CONFIGURATION, topics.MANAGER_PROGRESS)


def newest(depth: int) -> QoSProfile:
    """BEST_EFFORT and KEEP_LAST: no publisher waits for this reader, and lost messages are not sent again."""
    return QoSProfile(reliability=ReliabilityPolicy.BEST_EFFORT, history=HistoryPolicy.KEEP_LAST, depth=depth)


class ViewNode(Node):  # type: ignore[misc]  # rclpy is not followed by mypy
    """Passes published messages to a :class:`LiveRun`; the player knows the node's name and does not wait for it."""

    def __init__(self, belief: str = topics.BELIEF, words: list[str] | None = None) -> None:
        """``belief``: topic of the belief, from which the names of the manager's other topics and the namespace follow.

        ``words``: ROS arguments, the first being ``--ros-args``.
        """
        manager, _, _ = belief.rpartition("/")
        namespace = manager.rpartition("/")[0]
        renamed = [f"{topic}:={manager}/{topic.rpartition('/')[2]}" for topic in OF_THE_MANAGER]
        renamed[0] = f"{topics.BELIEF}:={belief}"
        rules = [word for rule in renamed if belief != topics.BELIEF for word in ("-r", rule)]
        super().__init__("view", namespace=namespace or None, cli_args=["--ros-args", *rules, *(words or [])[1:]])
        self.run = LiveRun(self.resolve_topic_name(topics.BELIEF), self.get_namespace())
        take, run = self._take, self.run
        take(topics.BELIEF, run.add_belief, newest(DEPTH))
        take(topics.MEASUREMENTS, run.add_measurements, newest(DEPTH))
        take(topics.RUN_CONFIGURATION, run.add_configuration, qos.latched())
        take(topics.MANAGER_PROGRESS, run.add_progress, newest(1))
        take(topics.GROUND_TRUTH_OBJECTS, run.add_true_objects, qos.latched())
        take(topics.GROUND_TRUTH_ODOMETRY, run.add_true_pose, newest(DEPTH))
        take(topics.DIAGNOSTICS, run.add_diagnostics, newest(DEPTH), read=deserialize)
        self._has_camera = False
        self.create_timer(LOOK_S, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _take(
        self,
        topic: str,
        handle: Callable[[Any], None],
        profile: QoSProfile,
        read: Callable[[bytes, str], Any] = decode,
    ) -> None:
        """Subscribe: ``handle`` is called with each decoded message; unusable ones are counted."""
        kind = topics.TYPES[topic]

        def taken(data: bytes) -> None:
            try:
                handle(read(data, kind))
            except MessageError as fault:
                self.run.refused[f"{topic}: {fault.kind}"] += 1
            except Exception as fault:  # no message may end the page, which continues with the next one
                self.run.refused[f"{topic}: message cannot be shown"] += 1
                self.get_logger().warning(f"{topic}: {fault!r}", throttle_duration_sec=SAY_AGAIN_S)

        if is_installed(kind):
            self.create_subscription(ros_type(kind), self._name(topic), taken, profile, raw=True)

    def _name(self, topic: str) -> str:
        """Topic name relative to the manager's namespace; the manager's own topics are renamed by remapping rules."""
        return topic if topic in OF_THE_MANAGER else relative_name(topic)

    def _look(self) -> None:
        """Count the publishers of the belief, and subscribe to the camera topic that has a publisher."""
        self.run.publishers = self.count_publishers(self.run.topic)
        for topic in PICTURES:
            if not self._has_camera and self.count_publishers(self.resolve_topic_name(topic)):
                self._has_camera = True
                self._take(topic, self.run.add_picture, newest(PICTURES_DEPTH), read=deserialize)


def serve(host: str, port: int, belief: str, words: list[str]) -> None:
    """Serve the page until interrupted. Raises InputError, and any exception that ended the node."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    os.environ.setdefault(*WITHOUT_SHARED_MEMORY)
    without_ros_arguments(["view", *words])
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    listener = None
    try:
        node = _node(belief, words)
        with ViewServer(host, port, node.run) as server:
            print(f"{server.address} shows {node.run.topic}; Ctrl-C ends it", flush=True)
            if not server.is_of_this_machine:
                print(f"whoever reaches {host} may look; nobody can change anything", file=sys.stderr, flush=True)
            listener = Listener(node, server)
            listener.start()
            server.serve_forever()
            raise listener.fault or SemanticSlamError("view: the node has ended")
    finally:
        rclpy.try_shutdown()
        if listener is not None:
            listener.join(JOIN_S)


class Listener(threading.Thread):
    """Thread that spins the node; an exception there shuts the server down, too."""

    def __init__(self, node: ViewNode, server: ViewServer) -> None:
        super().__init__(daemon=True)
        self._node, self._server = node, server
        self.fault: Exception | None = None

    def run(self) -> None:
        executor = SingleThreadedExecutor()
        executor.add_node(self._node)
        try:
            executor.spin()
        except ExternalShutdownException:
            return
        except Exception as fault:
            self.fault = fault
        self._server.shutdown()


def _node(belief: str, words: list[str]) -> ViewNode:
    try:
        return ViewNode(belief, words)
    except (RuntimeError, ValueError) as fault:  # names of topics and ROS arguments
        raise InputError(
            f"view: {PLACE_IN_RCL.sub('', one_line(fault, 300))}; see --belief and ROS arguments"
        ) from None
