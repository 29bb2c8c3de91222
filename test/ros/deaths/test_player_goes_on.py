"""A player in place of one that died goes on at once, live, too, and does not wait out what was played."""

import time
from pathlib import Path

import pytest
import rclpy
from worlds.bags.bag_factory import Entry, frame_stamp, input_entries, write_bag
from worlds.processes.node_runs import TIMEOUT_S, processes

from semantic_slam.messages import topics
from semantic_slam.messages.codec import encode
from semantic_slam.messages.ground_truth import ReplayProgress
from semantic_slam.messages.standard import NANOSECONDS
from semantic_slam.ros.launching.node_set import NodeSpec
from semantic_slam.ros.replay.resumption import MARGIN, header_stamp_ns
from semantic_slam.ros.wire import qos
from semantic_slam.ros.wire.transport import Outlet, receive, relative_name

NUM_FRAMES, DONE = 16, 12
PAUSE_NS = 3600 * NANOSECONDS
"""In the recording, between its first frame and the others: nobody would wait for it."""


def with_a_pause(entries: list[Entry]) -> list[Entry]:
    for entry in entries:
        if entry.stamp_ns <= frame_stamp(0):
            entry.stamp_ns -= PAUSE_NS
    return entries


@pytest.mark.long
@pytest.mark.ros
@pytest.mark.slow
@pytest.mark.parametrize("resume", [True, False])
def test_live_a_player_in_place_of_one_that_died_goes_on_and_another_one_begins(tmp_path: Path, resume: bool) -> None:
    bag = write_bag(tmp_path / "bag", with_a_pause(input_entries(NUM_FRAMES, with_depth=False)))
    heard: list[int] = []
    rclpy.init()
    try:
        node = rclpy.create_node("listener")
        receive(node, topics.DETECTIONS, lambda data: heard.append(header_stamp_ns(data)), qos.everything())
        manager = relative_name(topics.MANAGER_PROGRESS)
        progress = Outlet(node, manager, topics.TYPES[topics.MANAGER_PROGRESS], qos.latched())
        progress.send(encode(ReplayProgress(frame_stamp(DONE), frames=DONE + 1, finished=False)))
        parameters = {"bag": str(bag), "rate": 1.0, "resume": resume, "wait_for_listeners_s": 5.0}
        with processes(tmp_path) as nodes:
            nodes.start(NodeSpec("bag_player", "bag_player", parameters))
            give_up = time.monotonic() + TIMEOUT_S
            while not heard and time.monotonic() < give_up:
                rclpy.spin_once(node, timeout_sec=0.05)
                nodes.check()
        assert heard[0] == frame_stamp(DONE - MARGIN if resume else 0)
        node.destroy_node()
    finally:
        rclpy.try_shutdown()
