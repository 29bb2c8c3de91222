"""Poses of a bag that are replayed: those that a running system had before its first keyframe."""

import time
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
import rclpy
from worlds.bags.bag_factory import START, Entry, input_entries, noisy, write_bag
from worlds.processes.node_runs import TIMEOUT_S, processes

from semantic_slam.messages import topics
from semantic_slam.messages.codec import decode, to_message
from semantic_slam.messages.standard import NANOSECONDS, PoseEstimate
from semantic_slam.ros.launching.node_set import NodeSpec
from semantic_slam.ros.wire import qos
from semantic_slam.ros.wire.transport import receive

LATE_S = 5.0


def _pose(x_m: float, log_ns: int) -> Entry:
    estimate = PoseEstimate(log_ns, "map", np.array([x_m, 0, 0, 0, 0, 0, 1.0]), np.eye(6))
    return Entry(topics.INITIAL_POSE, to_message(estimate), log_ns)


def _heard(bag: Path, folder: Path) -> dict[str, list[bytes]]:
    """Messages of a player by topic, until poses and its end have come."""
    heard: dict[str, list[bytes]] = defaultdict(list)
    rclpy.init()
    try:
        node = rclpy.create_node("listener")
        receive(node, topics.INITIAL_POSE, heard[topics.INITIAL_POSE].append, qos.latched())
        receive(node, topics.PLAYER_PROGRESS, heard[topics.PLAYER_PROGRESS].append, qos.latched_by_any())
        receive(node, topics.DETECTIONS, heard[topics.DETECTIONS].append, qos.everything())
        with processes(folder) as nodes:
            parameters = {"bag": str(bag), "rate": 20.0, "wait_for_listeners_s": 10.0}
            nodes.start(NodeSpec("bag_player", "bag_player", parameters))
            give_up = time.monotonic() + TIMEOUT_S
            while not (heard[topics.PLAYER_PROGRESS] and heard[topics.INITIAL_POSE]) and time.monotonic() < give_up:
                rclpy.spin_once(node, timeout_sec=0.05)
        node.destroy_node()
    finally:
        rclpy.try_shutdown()
    return heard


@pytest.mark.long
@pytest.mark.ros
@pytest.mark.slow
def test_what_comes_before_the_damage_of_a_bag_is_played(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", noisy([_pose(1.0, START), *input_entries(24)]))
    data = (bag / "bag.mcap").read_bytes()
    (bag / "bag.mcap").write_bytes(data[: int(0.6 * len(data))])
    heard = _heard(bag, tmp_path)
    assert len(heard[topics.INITIAL_POSE]) == 1
    assert len(heard[topics.DETECTIONS]) > 5


@pytest.mark.long
@pytest.mark.ros
@pytest.mark.slow
def test_a_pose_set_during_the_recorded_run_is_not_sent_before_its_frames(tmp_path: Path) -> None:
    late_ns = START + int(LATE_S * NANOSECONDS)
    poses = [_pose(1.0, START), _pose(2.0, late_ns)]
    bag = write_bag(tmp_path / "bag", [*input_entries(with_depth=False), *poses])
    received = _heard(bag, tmp_path)[topics.INITIAL_POSE]
    assert [decode(cdr, topics.TYPES[topics.INITIAL_POSE]).pose[0] for cdr in received] == [1.0]
    said = (tmp_path / "log" / "bag_player.log").read_text()
    assert f"the pose of {late_ns / NANOSECONDS:.3f} s is not used, as it comes {LATE_S:.1f} s after" in said
