"""``semantic_slam view`` beside a run: what is published is what the page is told, and an interrupt ends it at once."""

import json
import re
import signal
import subprocess
import sys
import time
import urllib.request
from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import rclpy
from rclpy.node import Node
from worlds.belief_factory import (
    CLASSES,
    OBJECTS,
    START,
    belief_at,
    compressed_image,
    measurements_at,
    odometry_message,
    picture,
    run_configuration,
    true_path,
    visible,
)

from semantic_slam.messages import topics
from semantic_slam.messages.codec import encode
from semantic_slam.messages.node_status import status_name
from semantic_slam.messages.typestore import serialize
from semantic_slam.pipeline.diagnostics import dropped_message
from semantic_slam.ros.wire import qos
from semantic_slam.ros.wire.transport import Outlet

pytestmark = pytest.mark.ros

VIEW = [sys.executable, "-m", "semantic_slam.cli.commands", "view", "--port", "0"]
NAMESPACE = "/robot"
PATIENCE_S = 120.0
PATH = true_path(24)
BELIEF = NAMESPACE + topics.BELIEF


class Robot:
    """Publishes what a manager, a classifier and a camera would, in a namespace."""

    def __init__(self) -> None:
        self.node = Node("robot", namespace=NAMESPACE)
        every, latched = qos.everything(), qos.latched()
        self._outlets = {
            topic: Outlet(self.node, topic if topic == topics.DIAGNOSTICS else topic.lstrip("/"), kind, profile)
            for topic, kind, profile in (
                (topic, topics.TYPES[topic], latched if topic in topics.LATCHED else every)
                for topic in (
                    *(topics.BELIEF, topics.MEASUREMENTS, topics.IMAGE_COMPRESSED, topics.DIAGNOSTICS),
                    *(topics.RUN_CONFIGURATION, topics.GROUND_TRUTH_ODOMETRY),
                )
            )
        }

    def send(self, topic: str, data: bytes) -> None:
        self._outlets[topic].send(data)

    def wait_for_view(self) -> None:
        give_up = time.monotonic() + PATIENCE_S
        while not all(outlet.num_readers for outlet in self._outlets.values()):
            assert time.monotonic() < give_up
            time.sleep(0.02)

    def keyframe(self, k: int) -> None:
        stamp, seen = START + k * 1_000_000_000, visible(PATH[k])
        self.send(topics.GROUND_TRUTH_ODOMETRY, encode(odometry_message(stamp, PATH[k], "map")))
        self.send(topics.IMAGE_COMPRESSED, serialize(compressed_image(stamp, picture(k, seen))))
        self.send(topics.MEASUREMENTS, encode(measurements_at(k, seen, CLASSES)))
        self.send(topics.BELIEF, encode(belief_at(k, PATH, CLASSES, ("",) * len(OBJECTS))))


@pytest.fixture
def robot() -> Iterator[Robot]:
    rclpy.init()
    own = Robot()
    yield own
    own.node.destroy_node()
    rclpy.shutdown()


@pytest.fixture
def view() -> Iterator[tuple[subprocess.Popen[str], str]]:
    """The command, and where its page is."""
    process = subprocess.Popen(
        [*VIEW, "--belief", BELIEF],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),  # whoever runs tests may ignore it
    )
    assert process.stdout is not None
    line = process.stdout.readline()
    address = re.match(r"(http://127\.0\.0\.1:\d+/) shows /robot/hypothesis_manager/belief; Ctrl-C ends it", line)
    assert address is not None, line
    yield process, address[1]
    process.kill()
    process.communicate()


def page(address: str, condition: Any) -> dict[str, Any]:
    """What the page is told, once it is as ``condition`` wants it."""
    give_up = time.monotonic() + PATIENCE_S
    while True:
        with urllib.request.urlopen(f"{address}changes", timeout=PATIENCE_S) as answer:
            told: dict[str, Any] = json.load(answer)
        if condition(told):
            return told
        assert time.monotonic() < give_up, told
        time.sleep(0.05)


def dropped_by(node: str, **reasons: int) -> bytes:
    """Diagnostics of a node, which has dropped so much."""
    message = dropped_message(START, {"frames": Counter(reasons)})
    message.status[0].name = status_name(node, "frames")
    return serialize(message)


@pytest.mark.long
def test_the_page_follows_a_run(robot: Robot, view: tuple[subprocess.Popen[str], str], tmp_path: Any) -> None:
    process, address = view
    assert page(address, lambda told: told["state"]["publishers"] == 1)["frames"] == []
    robot.wait_for_view()
    robot.send(topics.RUN_CONFIGURATION, encode(run_configuration(tmp_path, CLASSES, ("",) * len(OBJECTS))))
    diagnostics = dropped_by("/robot/classifier", late=3)
    robot.send(topics.DIAGNOSTICS, dropped_by("/other/classifier", lost=7))
    page(address, lambda told: robot.send(topics.DIAGNOSTICS, diagnostics) or told["dropped"])
    robot.send(topics.BELIEF, b"no message at all")
    for k in range(5, 9):  # the view came in the midst of the run
        robot.keyframe(k)
    told = page(address, lambda told: len(told["frames"]) == 4 and len(told["pictures"]) == 4 and told["run"]["id"])
    assert [frame["k"] for frame in told["frames"]] == [5, 6, 7, 8] and told["state"]["missed"] == 0
    assert np.hypot(*(np.array(told["truth"][-1][:2]) - PATH[8, :2])) < 0.01
    assert ["robot/classifier", "late", "3"] in told["dropped"] and "other" not in str(told["dropped"])
    assert ["view", f"{topics.BELIEF}: message does not decode", "1"] in told["dropped"]
    with urllib.request.urlopen(address + told["pictures"][-1]["src"], timeout=PATIENCE_S) as answer:
        assert answer.headers["Content-Type"] == "image/jpeg" and answer.read(2) == b"\xff\xd8"
    process.send_signal(signal.SIGINT)
    assert process.wait(10.0) == 130  # 0.4 s on a machine that is not busy
    assert process.stderr is not None and "Traceback" not in process.stderr.read()
