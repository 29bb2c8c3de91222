"""Colour and depth each find the transport that somebody publishes, and a hostile message ends no node."""

import json
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import rclpy
from worlds.bags.bag_factory import (
    T_BASE_CAMERA,
    Entry,
    input_entries,
    of_topic,
    without,
    write_bag,
    write_configuration,
)
from worlds.bags.raw_image import raw_image
from worlds.bags.stereo import disparity_of
from worlds.processes.node_runs import Replay, assert_same, beliefs, processes, run

from semantic_slam.configuration import load_configuration
from semantic_slam.messages import topics
from semantic_slam.messages.codec import decode
from semantic_slam.messages.typestore import serialize
from semantic_slam.pipeline.offline import run_bag
from semantic_slam.ros.launching.node_set import NodeSpec
from semantic_slam.ros.wire import qos
from semantic_slam.ros.wire.transport import Outlet, is_installed, receive

pytestmark = [pytest.mark.ros, pytest.mark.slow]

START_S = 120.0
SENT = {
    topics.CAMERA_INFO: topics.CAMERA_INFO,
    topics.IMAGE_COMPRESSED: topics.IMAGE_COMPRESSED,
    topics.DETECTIONS: topics.DETECTIONS,
}
"""Topic -> where the small bag has its messages; depth comes besides."""


def raw(message: Any) -> Any:
    """A depth png as the raw image of a driver."""
    pixels = cv2.imdecode(np.asarray(message.data), cv2.IMREAD_UNCHANGED)
    return raw_image(message.header, pixels, "16UC1")


def unchanged(message: Any) -> Any:
    return message


RAW = {topics.DEPTH: raw, topics.DISPARITY: disparity_of}
"""Topic -> what a driver makes of a depth png."""


@pytest.mark.long
@pytest.mark.parametrize("depth", [topics.DEPTH, topics.DISPARITY])
def test_compressed_colour_with_raw_depth_gives_ranges_and_garbage_in_between_gives_nothing(
    tmp_path: Path, depth: str
) -> None:
    if not is_installed(topics.TYPES[depth]):
        pytest.skip(f"{topics.TYPES[depth]} is not installed")
    network = json.loads(write_configuration(tmp_path).read_text())["perception"]["network"]
    parameters = {
        "lossless": True,
        "perception.network": network,
        "perception.num_passes": 1,
        "perception.extrinsics": T_BASE_CAMERA.tolist(),
    }
    measured: list[Any] = []
    rclpy.init()
    try:
        with processes(tmp_path) as nodes:
            nodes.start(NodeSpec("classifier_node", "classifier", parameters))
            node = rclpy.create_node("sender")
            profile = qos.result(True)
            name = topics.MEASUREMENTS
            receive(node, name, lambda data: measured.append(decode(data, topics.TYPES[name])), profile)
            sent = {**SENT, depth: topics.DEPTH_COMPRESSED}
            outlets = {topic: Outlet(node, topic, topics.TYPES[topic], qos.replayed(topic)) for topic in sent}
            assert all(outlet.wait_for_readers(1, START_S) for outlet in outlets.values())
            entries = input_entries(num_frames=3)
            for topic, source in sent.items():
                outlets[topic].send(b"\x00\x01\x00\x00" + b"\xff" * 60)
                for entry in of_topic(entries, source):
                    outlets[topic].send(serialize(RAW.get(topic, unchanged)(entry.message)))
            give_up = time.monotonic() + START_S
            while len(measured) < 2 and time.monotonic() < give_up:
                nodes.check()
                rclpy.spin_once(node, timeout_sec=0.1)
            node.destroy_node()
            said = (tmp_path / "log" / "classifier.log").read_text()
    finally:
        rclpy.try_shutdown()
    assert len(measured) >= 2
    assert all(np.isfinite(item.ranges_m).all() and len(item) == 2 for item in measured)
    assert "ready" in said and "do not decode" in said and "Traceback" not in said


@pytest.mark.long
def test_a_bag_with_depth_images_and_disparities_is_replayed_with_the_depth_images(tmp_path: Path) -> None:
    """Losslessly, and as offline: the player does not wait for a listener to the disparities, which nobody reads."""
    entries = input_entries(num_frames=3)
    depths = of_topic(entries, topics.DEPTH_COMPRESSED)
    besides = [Entry(topic, make(entry.message), entry.stamp_ns) for entry in depths for topic, make in RAW.items()]
    bag = write_bag(tmp_path / "bag", [*without(entries, topics.DEPTH_COMPRESSED), *besides])
    configuration = write_configuration(tmp_path / "configuration")
    run_bag(bag, tmp_path / "offline", load_configuration(configuration))
    replayed = run(Replay(bag, configuration, tmp_path, 1))
    assert len(replayed) == 3
    assert_same(replayed, beliefs(tmp_path / "offline"))
