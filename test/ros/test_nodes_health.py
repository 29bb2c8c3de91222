"""A node says what is wrong, by name, within five seconds."""

import json
import subprocess
import time
from collections.abc import Iterator, Sequence

import pytest
import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from worlds.bags.bag_factory import T_BASE_CAMERA, input_entries, of_topic, write_configuration
from worlds.processes.node_runs import processes

from semantic_slam.messages import topics
from semantic_slam.messages.typestore import deserialize, serialize
from semantic_slam.ros.launching.node_set import NodeSpec
from semantic_slam.ros.wire import qos
from semantic_slam.ros.wire.transport import Outlet, receive, ros_type

pytestmark = [pytest.mark.ros, pytest.mark.slow]

PATIENCE_S = 240.0
NUM_TERMINATED = 2
SENT = (topics.CAMERA_INFO, topics.IMAGE_COMPRESSED, topics.DETECTIONS)
SILENT = [("classifier: ", f"{topic} is silent") for topic in ("/image/compressed", "/camera_info", "/detections")]


class Listener:
    """A ROS node of the test's own that follows /diagnostics."""

    def __init__(self) -> None:
        self.node: Node = rclpy.create_node("listener")
        self.heard: list[tuple[int, str]] = []  # level and "name: message"
        self.before_any_input: list[str] = []
        receive(self.node, topics.DIAGNOSTICS, self._note, qos.everything())

    def _note(self, data: bytes) -> None:
        for status in deserialize(data, topics.TYPES[topics.DIAGNOSTICS]).status:
            self.heard.append((int(status.level), f"{status.name}: {status.message}"))

    def wait_for(self, level: int, *words: str, within_s: float) -> str:
        """The first status from now on of that level that contains all words; fails after ``within_s``."""
        return self.wait_for_each(level, [words], within_s)[0]

    def wait_for_each(self, level: int, wanted: Sequence[Sequence[str]], within_s: float) -> list[str]:
        """Likewise for each of several sets of words."""
        self.heard.clear()
        give_up = time.monotonic() + within_s
        while time.monotonic() < give_up:
            rclpy.spin_once(self.node, timeout_sec=0.1)
            told = [text for own, text in self.heard if own == level]
            found = [next((text for text in told if all(word in text for word in words)), "") for words in wanted]
            if all(found):
                return found
        raise AssertionError(f"no status of level {level} with {wanted} in {within_s:.0f} s; heard {self.heard}")


@pytest.fixture(scope="module")
def backends() -> Iterator[list[subprocess.Popen[str]]]:
    """Backends that nobody gives work."""
    command = ["backend_node", "--ros-args", "-p"]
    nodes = [
        subprocess.Popen(
            [*command, f"backend_id:={n}", "-r", f"__node:=backend_{n}"], stderr=subprocess.PIPE, text=True
        )
        for n in range(NUM_TERMINATED)
    ]
    yield nodes
    for node in nodes:
        node.kill()
        node.wait()


@pytest.fixture(scope="module")
def listener(tmp_path_factory: pytest.TempPathFactory, backends: list[subprocess.Popen[str]]) -> Iterator[Listener]:
    """A lossless classifier that accepts boxes labelled ``chair`` only, and nobody who sends it anything yet.

    The ``backends`` start meanwhile.
    """
    folder = tmp_path_factory.mktemp("health")
    network = json.loads(write_configuration(folder).read_text())["perception"]["network"]
    parameters = {
        "lossless": True,
        "has_depth": False,
        "perception.network": network,
        "perception.num_passes": 1,
        "perception.labels": ["chair"],
        "perception.extrinsics": T_BASE_CAMERA.tolist(),
    }
    rclpy.init()
    with processes(folder) as nodes:
        nodes.start(NodeSpec("classifier_node", "classifier", parameters))
        listener = Listener()
        listener.wait_for(0, "classifier: ", within_s=PATIENCE_S)
        listener.before_any_input = listener.wait_for_each(2, SILENT, within_s=PATIENCE_S)
        yield listener
        listener.node.destroy_node()
    rclpy.try_shutdown()


def send_frames(listener: Listener) -> None:
    """Two frames with boxes of another label."""
    outlets = {topic: Outlet(listener.node, topic, topics.TYPES[topic], qos.replayed(topic)) for topic in SENT}
    assert all(outlet.wait_for_readers(1, PATIENCE_S) for outlet in outlets.values())
    entries = input_entries(num_frames=2, with_depth=False)
    for topic in SENT:
        for entry in of_topic(entries, topic):
            outlets[topic].send(serialize(entry.message))


@pytest.mark.long
def test_silent_topics_are_named(listener: Listener) -> None:
    assert len(listener.before_any_input) == len(SILENT)
    assert all("start its publisher or remap the topic" in text for text in listener.before_any_input)


def test_unknown_label_is_named(listener: Listener) -> None:
    send_frames(listener)
    listener.wait_for(1, "classifier: dropped", "unknown label 'box'", within_s=PATIENCE_S)


def test_publisher_whose_qos_cannot_match_is_named(listener: Listener) -> None:
    best_effort = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT, durability=DurabilityPolicy.VOLATILE)
    listener.node.create_publisher(ros_type(topics.TYPES[topics.CAMERA_INFO]), "camera_info", best_effort)
    text = listener.wait_for(2, "classifier: QoS", "/camera_info", within_s=PATIENCE_S)
    assert "incompatible" in text


def test_topic_that_falls_silent_is_named(listener: Listener) -> None:
    send_frames(listener)
    listener.wait_for(1, "/image/compressed has been silent", within_s=PATIENCE_S)


@pytest.fixture
def places() -> Iterator[None]:
    """A classifier without pictures, whose camera_info and detections have names of their own."""
    names = ["__node:=places", "detections:=boxes", "camera_info:=intrinsics"]
    remaps = [word for name in names for word in ("-r", name)]
    node = subprocess.Popen(
        ["classifier_node", "--ros-args", "-p", "has_images:=false", "-p", "lossless:=true", *remaps]
    )
    yield
    node.kill()
    node.wait()


def test_boxes_that_wait_for_a_camera_are_named_until_it_comes(listener: Listener, places: None) -> None:
    entries = input_entries(num_frames=2, with_depth=False)
    sent = {"boxes": topics.DETECTIONS, "intrinsics": topics.CAMERA_INFO}
    outlets = {
        name: Outlet(listener.node, name, topics.TYPES[topic], qos.replayed(topic)) for name, topic in sent.items()
    }
    said = [(1, "2 x detections with boxes that wait for camera_info"), (0, "none wait")]
    for (name, outlet), (level, words) in zip(outlets.items(), said, strict=True):
        assert outlet.wait_for_readers(1, PATIENCE_S)
        for entry in of_topic(entries, sent[name]):
            outlet.send(serialize(entry.message))
        listener.wait_for(level, "places: boxes", words, within_s=PATIENCE_S)


def test_terminated_nodes_end_at_once_and_quietly(listener: Listener, backends: list[subprocess.Popen[str]]) -> None:
    """Whatever they were about to publish: nobody is left to take it."""
    for n in range(len(backends)):
        listener.wait_for(0, f"backend_{n}", within_s=PATIENCE_S)
    for node in backends:
        node.terminate()
    for node in backends:
        complaints = node.communicate(timeout=PATIENCE_S)[1]
        assert "Traceback" not in complaints
