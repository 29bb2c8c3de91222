"""A bag without pictures that is replayed again and again into the same nodes: each time another session.

The classifier passes places on, in lock-step with the others; labels name things, and some stamps are wrong.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import rclpy
from rclpy.node import Node
from std_srvs.srv import Trigger
from worlds.bags.bag_factory import frame_stamp, of_topic, write_bag, write_configuration
from worlds.bags.places import place_entries
from worlds.processes.node_runs import TIMEOUT_S, assert_same, beliefs, processes
from worlds.processes.services import answered

from semantic_slam.configuration import load_configuration
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.messages import topics
from semantic_slam.messages.codec import decode, from_message, to_message
from semantic_slam.messages.standard import NANOSECONDS, header_stamp_ns, time_message
from semantic_slam.pipeline.offline import RunSummary, run_bag
from semantic_slam.ros.launching.node_set import NodeSpec, RunOptions, node_set
from semantic_slam.ros.launching.processes import NodeProcesses
from semantic_slam.ros.wire import qos
from semantic_slam.ros.wire.transport import receive
from semantic_slam.viewpoint.labels.model import NONE_OF_THESE

pytestmark = [pytest.mark.ros, pytest.mark.slow]

NUM_FRAMES, LOST = 12, 7
"""More than a player that goes on sends again; the frame whose detections are told so wrongly that they are lost."""
AHEAD_NS = (
    (topics.ODOMETRY, 4, 1_000_000 * NANOSECONDS),
    (topics.DETECTIONS, LOST, 5 * NANOSECONDS),
    (topics.ODOMETRY, NUM_FRAMES, 5 * NANOSECONDS),  # the last one: nothing comes that could tell
)
"""Topic and place of a message, and how much too late its stamp is."""
LEAPS = "stamp leaps ahead of those around it"


@dataclass(frozen=True)
class Replays:
    """What nodes said in three replays, and what the offline pipeline makes of the bag."""

    live: list[HybridBelief]
    offline: list[HybridBelief]
    summary: RunSummary


def drive(path: Path) -> Path:
    """Two frames show and name nothing; live the first detections after them name the classes."""
    entries = place_entries("ranges", NUM_FRAMES)
    for k, entry in enumerate(of_topic(entries, topics.DETECTIONS)):
        found = from_message(entry.message)
        labels = ("chair", "cup") if found.stamp_ns % 3 else ("cup", "cup")
        told = replace(found, labels=labels, class_names=("chair", "cup", "tv"))
        entry.message = to_message(told if k >= 2 else found.take(np.zeros(0, dtype=int)))
    for topic, place, ahead_ns in AHEAD_NS:
        message = of_topic(entries, topic)[place].message
        message.header.stamp = time_message(header_stamp_ns(message) + ahead_ns)
    return write_bag(path, entries)


def replayed(specs: Sequence[NodeSpec], nodes: NodeProcesses, node: Node, num_beliefs: int) -> list[HybridBelief]:
    """Beliefs of one replay, of another one after it, and of a third one after a reset; the last spec is the player."""
    heard: list[HybridBelief] = []
    kind = topics.TYPES[topics.BELIEF]
    receive(node, topics.BELIEF, lambda data: heard.append(decode(data, kind)), qos.everything_from_the_start())
    for spec in specs[:-1]:
        nodes.start(spec)
    for replay in (1, 2, 3):
        if replay == 3:
            answered(node, Trigger, "hypothesis_manager/reset", Trigger.Request())
        nodes.start(specs[-1])
        give_up = time.monotonic() + TIMEOUT_S
        while nodes.exit_code("bag_player") is None or len(heard) < replay * num_beliefs:
            rclpy.spin_once(node, timeout_sec=0.05)
            nodes.check()
            assert time.monotonic() < give_up, [belief.keyframe for belief in heard]
    return heard


@pytest.fixture(scope="module")
def replays(tmp_path_factory: pytest.TempPathFactory) -> Replays:
    folder = tmp_path_factory.mktemp("replays")
    settings = {"association": "open", "semantic_model": {"kind": "detector"}}
    configuration = write_configuration(folder, **settings, perception={"network": "nowhere.safetensors"})
    bag = drive(folder / "bag")
    summary = run_bag(bag, folder / "offline", load_configuration(configuration))
    specs = node_set(bag, configuration, 0.0, RunOptions(), has_tf2=False, has_stereo=True)
    rclpy.init()
    try:
        node = rclpy.create_node("listener")
        with processes(folder) as nodes:
            live = replayed(specs, nodes, node, summary.num_keyframes)
        node.destroy_node()
    finally:
        rclpy.try_shutdown()
    return Replays(live, beliefs(folder / "offline"), summary)


@pytest.mark.long
def test_another_replay_into_running_nodes_is_another_session_with_the_same_beliefs(replays: Replays) -> None:
    """The second one after the first, and a third one after a reset."""
    count = len(replays.offline)
    assert len(replays.live) == 3 * count
    for first in range(0, 3 * count, count):
        session = replays.live[first : first + count]
        assert [belief.keyframe for belief in session] == [*range(count)]
        assert_same(session, replays.offline)


def test_labels_give_the_names_of_the_offline_pipeline(replays: Replays) -> None:
    names = ("chair", "cup", "tv", NONE_OF_THESE)
    assert replays.live[-1].class_names == replays.offline[-1].class_names == names


def test_nodes_in_lock_step_judge_stamps_as_offline_does(replays: Replays) -> None:
    assert replays.summary.dropped == {f"odom: {LEAPS}": 1, f"detections: {LEAPS}": 1}
    right = [frame_stamp(k) for k in range(NUM_FRAMES) if k != LOST]
    assert [belief.stamp_ns for belief in replays.live] == 3 * right
