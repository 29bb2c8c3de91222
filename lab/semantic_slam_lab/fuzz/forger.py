"""A node that publishes forged messages on all topics that the nodes of a run subscribe to."""

import threading
from collections import Counter, defaultdict, deque
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import rclpy
from numpy.random import Generator
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from semantic_slam.bag.reader import BagReader
from semantic_slam.messages import topics
from semantic_slam.messages.typestore import deserialize
from semantic_slam.ros.replay.resumption import header_stamp_ns
from semantic_slam.ros.wire import qos
from semantic_slam.ros.wire.transport import Outlet, is_installed, receive, relative_name
from semantic_slam_lab.fuzz.forgery import forgery

NAME = "forger"
HEARD = (
    topics.MEASUREMENTS, topics.BELIEF, topics.POSE, topics.PATH, topics.MARKERS, topics.RUN_CONFIGURATION,
    topics.KEYFRAMES, topics.COMMITS, topics.CANDIDATES, topics.COMPONENTS, topics.MISSED, topics.CLASSIFIER_PROGRESS,
    topics.PLAYER_PROGRESS, topics.MANAGER_PROGRESS,
)  # fmt: skip
"""What forgeries are made of; of inputs it is what the bag has up to the newest belief."""
INPUTS = (
    topics.DETECTIONS, topics.IMAGE_COMPRESSED, topics.DEPTH_COMPRESSED, topics.DISPARITY, topics.CAMERA_INFO,
    topics.ODOMETRY, topics.INITIAL_POSE, topics.GROUND_TRUTH_ODOMETRY, topics.GROUND_TRUTH_OBJECTS,
    topics.GROUND_TRUTH_ASSOCIATIONS,
)  # fmt: skip
REMEMBERED = 50
NOTHING_TELLS = frozenset(("bag_recorder", topic, "out_of_turn") for topic in (topics.MEASUREMENTS, topics.ODOMETRY))
"""Forgeries (node, topic, kind) that a node cannot detect: a recorder does not judge what it records."""
COUNTS = ("dropped: ", "repeated: ")
"""How keys of diagnostics begin that tell what was not used."""


class Forger:
    """Knows what was sent, and sends what was not meant."""

    def __init__(self, node: Node, bag: Path) -> None:
        self.num_sent = 0
        self.owed: Counter[tuple[str, str, str]] = Counter()  # by node that is to count it, topic and kind
        self.counted: dict[str, dict[str, int]] = {}  # by node: what it has not used, by reason
        self.keyframe, self._stamp_ns = -1, 0  # of the newest belief
        self.node = node
        self._own: set[bytes] = set()
        self._heard: dict[str, deque[bytes]] = defaultdict(lambda: deque(maxlen=REMEMBERED))
        with BagReader(bag) as reader:
            self._inputs = [(message.topic, message.cdr) for message in reader.messages()]
        for topic in HEARD:
            if is_installed(topics.TYPES[topic]):
                receive(node, topic, partial(self._note, topic), qos.everything())
        receive(node, topics.DIAGNOSTICS, self._count, qos.everything())
        self._outlets = {
            topic: Outlet(node, relative_name(topic), topics.TYPES[topic], qos.everything_from_the_start())
            for topic in (*HEARD, *INPUTS, topics.DIAGNOSTICS)
            if is_installed(topics.TYPES[topic])
        }

    def _note(self, topic: str, data: bytes) -> None:
        if data in self._own:
            return
        self._heard[topic].append(data)
        if topic == topics.BELIEF:
            self.keyframe = int(deserialize(data, topics.TYPES[topic]).keyframe)
            self._hear_inputs(header_stamp_ns(data))

    def _hear_inputs(self, stamp_ns: int) -> None:
        """Take for heard whatever inputs have led to the belief of this stamp."""
        while self._inputs and header_stamp_ns(self._inputs[0][1]) <= stamp_ns:
            topic, data = self._inputs.pop(0)
            for known in INPUTS:
                if topic == f"/{relative_name(known)}":
                    self._heard[known].append(data)

    def _count(self, data: bytes) -> None:
        if data in self._own:
            return
        for status in deserialize(data, topics.TYPES[topics.DIAGNOSTICS]).status:
            own = self.counted.setdefault(status.name.partition(":")[0], {})
            own.update({told.key: int(told.value) for told in status.values if told.key.startswith(COUNTS)})

    def counted_of(self, node: str, topic: str) -> dict[str, int]:
        """How many messages of a topic a node says that it has not used, by reason."""
        names = tuple(f"{kind}{slash}{relative_name(topic)}" for kind in COUNTS for slash in ("", "/"))
        return {key: number for key, number in self.counted.get(node, {}).items() if _ends(key, names)}

    def send(self, chance: Generator) -> None:
        """One forged message to a topic that somebody reads."""
        read = [topic for topic, outlet in self._outlets.items() if outlet.num_readers]
        topic = read[chance.integers(len(read))]
        forged = forgery(topic, list(self._heard[topic]), chance)
        if forged.kind != "again":
            self._own.add(forged.data)
        for reader in self.node.get_subscriptions_info_by_topic(self._outlets[topic].name):
            if reader.node_name != NAME and (reader.node_name, topic, forged.kind) not in NOTHING_TELLS:
                self.owed[reader.node_name, topic, forged.kind] += 1
        self._outlets[topic].send(forged.data)
        self.num_sent += 1


def _ends(key: str, names: tuple[str, ...]) -> bool:
    """Whether a key is of one of the topics, not of one below it."""
    return any(key == name or key.startswith(f"{name}:") for name in names)


@contextmanager
def forger(bag: Path, domain_id: int) -> Iterator[Forger]:
    """A forger in a ROS domain, which hears from another thread."""
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain_id)
    node = rclpy.create_node(NAME, context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    made, is_over = Forger(node, bag), threading.Event()

    def hear() -> None:
        while not is_over.is_set():
            executor.spin_once(timeout_sec=0.1)

    thread = threading.Thread(target=hear, daemon=True)
    thread.start()
    try:
        yield made
    finally:
        is_over.set()
        thread.join()
        executor.shutdown()
        node.destroy_node()  # or what it sent from the start would reach whoever comes later
        context.try_shutdown()
