"""Poses of a bag that are replayed: those that a running system had before its first keyframe."""

import time
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


@pytest.mark.long
@pytest.mark.ros
@pytest.mark.slow
def test_what_comes_before_the_damage_of_a_bag_is_played(tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "bag", noisy([_pose(1.0, START), *input_entries(24)]))
    data = (bag / "bag.mcap").read_bytes()
    (bag / "bag.mcap").write_bytes(data[: int(0.6 * len(data))])
    poses: list[bytes] = []
    frames: list[bytes] = []
    ends: list[bytes] = []
    rclpy.init()
    try:
        node = rclpy.create_node("listener")
        receive(node, topics.INITIAL_POSE, poses.append, qos.latched())
        receive(node, topics.PLAYER_PROGRESS, ends.append, qos.latched_by_any())
        for topic in (topics.DETECTIONS, topics.ODOMETRY):
            receive(node, topic, frames.append, qos.sensor_input(topic, lossless=False))
        with processes(tmp_path) as nodes:
            parameters = {"bag": str(bag), "rate": 20.0, "wait_for_listeners_s": 10.0}
            nodes.start(NodeSpec("bag_player", "bag_player", parameters))
            give_up = time.monotonic() + TIMEOUT_S
            while not (ends and poses) and time.monotonic() < give_up:
                rclpy.spin_once(node, timeout_sec=0.05)
        assert len(poses) == 1
        assert len(frames) > 10
        node.destroy_node()
    finally:
        rclpy.try_shutdown()


@pytest.mark.long
@pytest.mark.ros
@pytest.mark.slow
def test_a_pose_set_during_the_recorded_run_is_not_sent_before_its_frames(tmp_path: Path) -> None:
    late_ns = START + int(LATE_S * NANOSECONDS)
    poses = [_pose(1.0, START), _pose(2.0, late_ns)]
    bag = write_bag(tmp_path / "bag", [*input_entries(with_depth=False), *poses])
    received: list[bytes] = []
    ends: list[bytes] = []
    rclpy.init()
    try:
        node = rclpy.create_node("listener")
        receive(node, topics.INITIAL_POSE, received.append, qos.latched())
        receive(node, topics.PLAYER_PROGRESS, ends.append, qos.latched_by_any())
        with processes(tmp_path) as nodes:
            parameters = {"bag": str(bag), "rate": 20.0, "wait_for_listeners_s": 10.0}
            nodes.start(NodeSpec("bag_player", "bag_player", parameters))
            give_up = time.monotonic() + TIMEOUT_S
            while not (ends and received) and time.monotonic() < give_up:
                rclpy.spin_once(node, timeout_sec=0.05)
        assert [decode(cdr, topics.TYPES[topics.INITIAL_POSE]).pose[0] for cdr in received] == [1.0]
        said = (tmp_path / "log" / "bag_player.log").read_text()
        assert f"the pose of {late_ns / NANOSECONDS:.3f} s is not used, as it comes {LATE_S:.1f} s after" in said
        node.destroy_node()
    finally:
        rclpy.try_shutdown()
