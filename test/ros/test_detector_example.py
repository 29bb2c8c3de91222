"""The example of a detector's node: what it publishes is what the nodes read."""

import importlib.util
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType, SimpleNamespace

import cv2
import numpy as np
import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from semantic_slam_msgs.msg import DetectionArray
from sensor_msgs.msg import CompressedImage, Image
from worlds.processes.installed import ROOT
from worlds.views.onnx_networks import black_with_block, write_network

from semantic_slam.errors import InputError, MessageError
from semantic_slam.messages import topics
from semantic_slam.messages.codec import decode
from semantic_slam.perception.frame import Detections

pytestmark = pytest.mark.ros

EXAMPLE = ROOT / "examples" / "detector_node.py"
NAMES = ("chair", "cup", "tv")
PATIENCE_S = 240.0


@pytest.fixture(scope="module")
def example() -> ModuleType:
    spec = importlib.util.spec_from_file_location("detector_node", EXAMPLE)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def picture(pixels: np.ndarray) -> CompressedImage:
    message = CompressedImage(format="png", data=cv2.imencode(".png", pixels)[1].tobytes())
    message.header.stamp.sec, message.header.frame_id = 7, "camera"
    return message


def read(data: bytes) -> Detections:
    """As the nodes read it, whose readers are of raw messages."""
    found = decode(data, topics.TYPES[topics.DETECTIONS])
    assert isinstance(found, Detections)
    return found


def boxes_of(count: int) -> Callable[..., Detections]:
    """A detector that sees as many things in every picture, whose corner it looks at."""

    def detect(image: np.ndarray, *, stamp_ns: int, frame_id: str) -> Detections:
        return Detections(
            stamp_ns=stamp_ns,
            frame_id=frame_id,
            boxes=np.tile([0.0, 1.0, float(image[0, 0, 0]), 40.0], (count, 1)),
            labels=("cup",) * count,
            scores=np.full(count, 0.6),
            track_ids=("",) * count,
            class_names=NAMES,
            class_scores=np.tile([0.1, 0.6, 0.2], (count, 1)),
        )

    return detect


@pytest.fixture
def node() -> Iterator[Node]:
    context = rclpy.Context()
    rclpy.init(context=context)
    node = Node("camera", context=context)
    yield node
    node.destroy_node()
    context.try_shutdown()


def on_the_wire(node: Node, message: DetectionArray) -> bytes:
    """A message as it arrives elsewhere."""
    received: list[bytes] = []
    node.create_subscription(DetectionArray, "detections", received.append, 10, raw=True)
    publisher = node.create_publisher(DetectionArray, "detections", 10)
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    give_up = time.monotonic() + PATIENCE_S
    while not received and time.monotonic() < give_up:
        publisher.publish(message)
        executor.spin_once(timeout_sec=0.2)
    return received[0]


@pytest.mark.parametrize("count", [2, 0])
def test_the_message_of_the_example_detector_is_read_as_what_was_seen(
    example: ModuleType, node: Node, count: int
) -> None:
    """Also when nothing is seen: then the message still says which classes there are."""
    red = np.zeros((48, 64, 3), dtype=np.uint8)
    red[..., 2] = 30
    found = read(on_the_wire(node, example.detection_array(boxes_of(count), picture(red))))
    assert (found.stamp_ns, found.frame_id, found.class_names) == (7 * 10**9, "camera", NAMES)
    assert found.labels == ("cup",) * count
    np.testing.assert_array_equal(found.boxes, np.tile([0.0, 1.0, 30.0, 40.0], (count, 1)))
    np.testing.assert_array_equal(found.class_scores, np.tile([0.1, 0.6, 0.2], (count, 1)))


def test_a_picture_that_does_not_decode_is_an_error_of_ours(example: ModuleType) -> None:
    with pytest.raises(MessageError, match="does not decode"):
        example.detection_array(boxes_of(1), CompressedImage(format="jpeg", data=b"none"))


def test_a_class_without_a_name_is_a_warning_and_the_node_goes_on(example: ModuleType) -> None:
    def detect(image: np.ndarray, *, stamp_ns: int, frame_id: str) -> Detections:
        raise InputError("net.onnx: it reports a class whose number is none of the 1 named ones")

    told: list[str] = []
    logger = SimpleNamespace(warning=lambda text, throttle_duration_sec: told.append(text))
    publisher = SimpleNamespace(publish=pytest.fail)
    node = SimpleNamespace(_detector=detect, _publisher=publisher, get_logger=lambda: logger)
    example.DetectorNode._detect(node, picture(np.zeros((4, 4, 3), dtype=np.uint8)))
    assert told == ["net.onnx: it reports a class whose number is none of the 1 named ones"]


def heard(node: Node, message: CompressedImage | Image, topic: str, words: list[str]) -> Detections:
    """What the example tells of a picture that is published until it answers."""
    received: list[Detections] = []
    node.create_subscription(DetectionArray, "detections", lambda told: received.append(read(told)), 10, raw=True)
    publisher = node.create_publisher(type(message), topic, 10)
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    detector = subprocess.Popen([sys.executable, str(EXAMPLE), *words])
    try:
        give_up = time.monotonic() + PATIENCE_S
        while not received and time.monotonic() < give_up:
            publisher.publish(message)
            executor.spin_once(timeout_sec=0.1)
    finally:
        detector.terminate()
    assert detector.wait(timeout=PATIENCE_S) == 0
    return received[0]


def test_a_network_of_open_input_and_layout_takes_both_from_parameters(node: Node, tmp_path: Path) -> None:
    """Rows of one score, six numbers, may be of two layouts."""
    network = write_network(tmp_path / "net.onnx", "one_class", open_sizes=(2, 3))
    (tmp_path / "net.names").write_text("bright")
    block = np.ascontiguousarray(black_with_block((64, 64), (16, 24, 24, 32), "red")[..., ::-1])
    words = [str(network), str(tmp_path / "net.names"), "--ros-args", "-p", "input_size:=64", "-p", "layout:=yolov5"]
    found = heard(node, picture(block), "image/compressed", words)
    assert found.labels == ("bright",)
    np.testing.assert_allclose(found.boxes, [[16.0, 24.0, 24.0, 32.0]], atol=1e-3)


@pytest.mark.real_data
@pytest.mark.slow
@pytest.mark.parametrize("compressed", [True, False])
def test_with_nanodet_the_node_finds_the_chairs_of_a_kitchen(
    node: Node, compressed: bool, data_set: Callable[[str], Path]
) -> None:
    weights = data_set("weights")
    # Small enough for one piece of DDS: of a raw picture in many pieces hardly one in sixty arrives at best effort.
    pixels = cv2.resize(cv2.imread(str(data_set("redkitchen") / "frame-000000.color.jpg")), (320, 240))
    height, width = pixels.shape[:2]
    raw = Image(height=height, width=width, encoding="bgr8", step=3 * width, data=pixels.tobytes())
    message, topic = (picture(pixels), "image/compressed") if compressed else (raw, "image")
    files = [str(weights / "nanodet_m.onnx"), str(weights / "coco.names")]
    found = heard(node, message, topic, [*files, "--ros-args", "-p", f"compressed:={compressed}".lower()])
    assert {"chair", "cup"} <= set(found.labels) and len(found.class_names) == 80
