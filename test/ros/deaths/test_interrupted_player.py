"""A player that is interrupted in the midst of a bag does not tell others that it has sent the whole of it."""

import time
from pathlib import Path

import pytest
import rclpy
from worlds.bags.bag_factory import input_entries, write_bag
from worlds.processes.node_runs import TIMEOUT_S, processes

from semantic_slam.messages import topics
from semantic_slam.ros.launching.node_set import NodeSpec
from semantic_slam.ros.wire import qos
from semantic_slam.ros.wire.transport import receive

NUM_FRAMES = 400
SETTLED_S = 1.0
"""So long the listener goes on after the player's end: what was sent before has come by then."""


@pytest.mark.long
@pytest.mark.ros
@pytest.mark.slow
def test_an_interrupted_player_does_not_announce_the_end_of_the_bag(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", input_entries(NUM_FRAMES, with_depth=False))
    frames: list[bytes] = []
    ends: list[bytes] = []
    rclpy.init()
    try:
        node = rclpy.create_node("listener")
        receive(node, topics.DETECTIONS, frames.append, qos.everything())
        receive(node, topics.PLAYER_PROGRESS, ends.append, qos.latched_by_any())
        with processes(tmp_path) as nodes:
            parameters = {"bag": str(bag), "rate": 1.0, "wait_for_listeners_s": 1.0}
            nodes.start(NodeSpec("bag_player", "bag_player", parameters))
            give_up = time.monotonic() + TIMEOUT_S
            while not frames and time.monotonic() < give_up:
                rclpy.spin_once(node, timeout_sec=0.05)
                nodes.check()
        assert nodes.exit_code("bag_player") == 0
        settled = time.monotonic() + SETTLED_S
        while time.monotonic() < settled:
            rclpy.spin_once(node, timeout_sec=0.05)
        assert 0 < len(frames) < NUM_FRAMES and not ends
        node.destroy_node()
    finally:
        rclpy.try_shutdown()
