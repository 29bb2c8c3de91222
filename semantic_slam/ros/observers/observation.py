"""Node that observes for a while: the ROS graph, the messages of all inputs, and the diagnostics of our nodes."""

import re
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Any

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

from semantic_slam.bag.mcap_stream import RawMessage
from semantic_slam.bag.names import absolute
from semantic_slam.doctor.graph import Endpoint, Graph, Said
from semantic_slam.doctor.summarise import ENCODING, LITTLE, serialised_stamp_ns
from semantic_slam.errors import InputError, one_line
from semantic_slam.messages import topics
from semantic_slam.messages.node_status import is_ours
from semantic_slam.messages.typestore import deserialize
from semantic_slam.ros.node.ros_arguments import PLACE_IN_RCL, without_ros_arguments
from semantic_slam.ros.wire import qos
from semantic_slam.ros.wire.shared_memory import remove_remains
from semantic_slam.ros.wire.transport import receive, relative_name

NAME = "doctor"
LEAST_S, EMPTY_S = 4.0, 8.0
"""Shortest observation, and its length if nothing is published. Discovery usually takes 0.1 s, sometimes 3 s."""
LOOK_S = 0.25
"""Period of polling the graph."""
MOST_BYTES = 200_000_000
"""Size of kept messages above which images are left out; raw 640 x 480 colour and depth at 30 Hz fill it in 4.3 s."""
PICTURES = frozenset(map(absolute, qos.PICTURES))
LATCHED = frozenset(map(absolute, topics.LATCHED))
READ_HERE = (
    topics.DETECTIONS, topics.IMAGE, topics.IMAGE_COMPRESSED, topics.DEPTH, topics.DEPTH_COMPRESSED, topics.DISPARITY,
    topics.CAMERA_INFO, topics.ODOMETRY, topics.IMU, topics.INITIAL_POSE, topics.TF, topics.TF_STATIC,
    topics.MEASUREMENTS,
)  # fmt: skip
ALIVE = re.compile(r"/backend_\d+/alive$")


class Observer:
    """Observes a running system without taking part in it."""

    def __init__(self, node: Node, executor: SingleThreadedExecutor) -> None:
        self.node = node
        self.messages: list[RawMessage] = []  # of the observed topics, under their default absolute names
        self.left_out: dict[str, list[tuple[int, int]]] = {}  # header stamp, arrival [ns] of images that are not kept
        self.heard: Counter[str] = Counter()
        resolved = {absolute(topic): self.resolved(topic) for topic in READ_HERE}
        self.names = {known: name for known, name in resolved.items() if known != name}  # of remapped topics
        self._executor, self._num_bytes, self._is_simulated = executor, 0, False
        self._said: dict[str, Said] = {}
        receive(node, topics.DIAGNOSTICS, self._note, qos.everything())

    def spin(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        """Spin for some seconds, or until a condition holds."""
        give_up = time.monotonic() + seconds
        while time.monotonic() < give_up and not until():
            self._executor.spin_once(timeout_sec=0.05)

    def observe(self, seconds: float, wanted: Callable[[Graph], Mapping[str, str]]) -> Graph:
        """Subscribe to topics (relative name -> type) as they appear; returns ``seconds`` after the last one did."""
        begin = time.monotonic()
        end, known = begin + EMPTY_S, set[str]()
        while True:
            self.spin(LOOK_S)
            self._follow_clock()
            graph = self.graph()
            new = {topic: kind for topic, kind in wanted(graph).items() if topic not in known}
            for topic, kind in new.items():
                self._listen(topic, kind)
            known |= new.keys()
            if new:
                end = max(time.monotonic() + seconds, begin + LEAST_S)
            if time.monotonic() > end:
                return graph

    def _follow_clock(self) -> None:
        """Use simulated time once /clock has a publisher."""
        if not self._is_simulated and self.node.count_publishers(topics.CLOCK):
            self._is_simulated = True
            self.node.set_parameters([Parameter("use_sim_time", value=True)])
            # Arrival times of another clock are useless; those of latched messages are not used at all.
            self.messages = [message for message in self.messages if message.topic in LATCHED]
            self._num_bytes = sum(len(message.cdr) for message in self.messages)
            self.left_out.clear()

    def _listen(self, topic: str, type_name: str) -> None:
        take = partial(self._take, absolute(topic), type_name)
        receive(self.node, topic, take, qos.sensor_input(topic, lossless=False), type_name)

    def graph(self) -> Graph:
        """Current state of the ROS graph."""
        publishers, readers = {}, {}
        for topic in READ_HERE:
            name = self.resolved(topic)
            publishers[absolute(topic)] = self._endpoints(self.node.get_publishers_info_by_topic(name))
            readers[absolute(topic)] = self._endpoints(self.node.get_subscriptions_info_by_topic(name))
        alive = [name for name, _ in self.node.get_topic_names_and_types() if ALIVE.search(name)]
        names = self.node.get_node_names_and_namespaces()
        return Graph(
            publishers=publishers,
            readers=readers,
            nodes=frozenset(name for name, space in names if space == self.node.get_namespace()),
            num_backends=sum(self.node.count_publishers(name) > 0 for name in alive),
            said=tuple(self._said.values()),
        )

    def resolved(self, topic: str) -> str:
        """Resolved name of one of our topics, after remapping."""
        return str(self.node.resolve_topic_name(relative_name(topic)))

    def _endpoints(self, found: Sequence[Any]) -> list[Endpoint]:
        return [
            Endpoint(
                node=item.node_name,
                type_name=item.topic_type,
                is_reliable=item.qos_profile.reliability == ReliabilityPolicy.RELIABLE,
                is_latched=item.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL,
            )
            for item in found
            if item.node_name != NAME
        ]

    def _take(self, topic: str, type_name: str, data: bytes) -> None:
        self.heard[topic] += 1
        if type_name not in topics.TYPES.values():  # messages of foreign types are only counted
            return
        arrival_ns = self.node.get_clock().now().nanoseconds
        if topic in PICTURES and self._num_bytes > MOST_BYTES:
            if len(data) >= ENCODING + LITTLE.size:
                self.left_out.setdefault(topic, []).append((serialised_stamp_ns(data), arrival_ns))
            return
        self._num_bytes += len(data)
        self.messages.append(RawMessage(topic, type_name, arrival_ns, bytes(data)))

    def _note(self, data: bytes) -> None:
        try:
            statuses = deserialize(data, topics.TYPES[topics.DIAGNOSTICS]).status
        except InputError:
            return
        for status in statuses:
            if is_ours(status, self.node.get_namespace()):
                self._said[status.name] = Said(int(status.level), status.name, status.message)


@contextmanager
def observer(ros_arguments: Sequence[str]) -> Iterator[Observer]:
    """Context manager of an :class:`Observer` with its own rclpy context; raises InputError for bad ROS arguments."""
    without_ros_arguments([NAME, *ros_arguments])
    context = Context()
    try:
        remove_remains()
        rclpy.init(args=list(ros_arguments), context=context)
        node = rclpy.create_node(NAME, context=context)
    except RuntimeError as fault:
        raise InputError(f"{PLACE_IN_RCL.sub('', one_line(fault, 300))}; see docs/ros.md") from None
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    try:
        yield Observer(node, executor)
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown(context=context)
