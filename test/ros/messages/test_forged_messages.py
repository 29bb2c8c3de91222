"""Messages that nobody of a replay sends, on all its topics, end no node, change no belief, and are counted.

So do requests that no service should get; they are refused.

``python -m semantic_slam_lab.fuzz --live`` does this with 2000 of them and the shipped bag.
"""

import os
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import rclpy
from semantic_slam_lab.fuzz.asker import Asker
from semantic_slam_lab.fuzz.forger import Forger, forger
from semantic_slam_lab.fuzz.live import disturb, uncounted
from worlds.bags.bag_factory import input_entries, write_bag, write_configuration
from worlds.bags.places import place_entries
from worlds.bags.stereo import by_stereo
from worlds.processes.node_runs import TIMEOUT_S, Replay, assert_same, beliefs, processes

from semantic_slam.configuration import load_configuration
from semantic_slam.errors import MessageError
from semantic_slam.messages import topics
from semantic_slam.messages.typestore import deserialize
from semantic_slam.pipeline.offline import run_bag
from semantic_slam.ros.wire import qos
from semantic_slam.ros.wire.transport import is_installed, receive

NUM_FRAMES, NUM_ATTACKED, NUM_FORGED = 20, 8, 300
SLOW_BACKEND = [sys.executable, str(Path(__file__).parents[1] / "faulty_backends.py"), "slow"]
CHECK_S = 0.02
FIRST_DOMAIN, DOMAINS = 199, 16
"""Apart from those of other tests, which are to hear nothing of this one."""
TELL_AT_THE_END = ("hypothesis_manager ", "classifier ")
"""Nodes that say once more, when a replay has ended, what they have counted; the others do so every second."""


def attack(forging: Forger, asking: Asker, chance: np.random.Generator) -> None:
    """As many as are due at the newest keyframe."""
    due = NUM_FORGED * min(forging.keyframe + 1, NUM_ATTACKED) // NUM_ATTACKED
    while forging.num_sent + asking.num_asked < due:
        disturb(forging, asking, chance)


@pytest.mark.long
@pytest.mark.ros
@pytest.mark.slow
def test_forged_messages_and_requests_change_nothing_and_are_counted_or_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    domain_id = FIRST_DOMAIN + int(os.environ["ROS_DOMAIN_ID"]) % DOMAINS
    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain_id))
    bag = write_bag(tmp_path / "bag", place_entries("ranges", NUM_FRAMES))
    configuration = write_configuration(tmp_path / "configuration")
    run_bag(bag, tmp_path / "offline", load_configuration(configuration))
    patient = {"bag_player": {"wait_for_listeners_s": TIMEOUT_S}}
    replay = Replay(bag, configuration, tmp_path, 1, parameters=patient)
    chance = np.random.default_rng(0)
    with forger(bag, domain_id) as forging, processes(tmp_path) as nodes:
        asking = Asker(forging.node, tmp_path)
        for spec in replay.specs():
            nodes.start(spec, SLOW_BACKEND if spec.name == "backend_0" else ())
        while nodes.exit_code("bag_recorder") is None:
            nodes.check()
            attack(forging, asking, chance)
            time.sleep(CHECK_S)
        nodes.wait("bag_player", TIMEOUT_S)
        missing = [line for line in uncounted(forging) if line.startswith(TELL_AT_THE_END)]
    assert forging.num_sent + asking.num_asked == NUM_FORGED
    assert_same(beliefs(replay.belief_bag), beliefs(tmp_path / "offline"))
    assert not missing
    assert len(asking.refused()) > 5 and not list(asking.findings())


@pytest.mark.ros
def test_whoever_listens_to_disparities_is_sent_forged_ones(tmp_path: Path) -> None:
    if not is_installed(topics.TYPES[topics.DISPARITY]):
        pytest.skip("stereo_msgs is not installed")
    domain_id, chance = int(os.environ["ROS_DOMAIN_ID"]), np.random.default_rng(0)
    received: list[bytes] = []
    rclpy.init(domain_id=domain_id)
    try:
        node = rclpy.create_node("listener")
        receive(node, topics.DISPARITY, received.append, qos.everything())
        with forger(write_bag(tmp_path / "bag", by_stereo(input_entries(1))), domain_id) as forging:
            assert forging._outlets[topics.DISPARITY].wait_for_readers(1, TIMEOUT_S)
            give_up = time.monotonic() + TIMEOUT_S
            while not received and time.monotonic() < give_up:
                forging.send(chance)
                rclpy.spin_once(node, timeout_sec=0.02)
        node.destroy_node()
    finally:
        rclpy.try_shutdown()
    with pytest.raises(MessageError, match="do not decode"):
        deserialize(received[0], topics.TYPES[topics.DISPARITY])
