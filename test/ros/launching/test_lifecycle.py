"""Nodes are lifecycle nodes: told to wait, they are configured, activated, paused and shut down from outside.

Active, they replay a bag without pictures, as the offline pipeline does.
"""

import time
from collections.abc import Callable
from pathlib import Path

import pytest
import rclpy
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from worlds.bags.bag_factory import write_bag, write_configuration
from worlds.bags.places import place_entries
from worlds.processes.node_runs import assert_same, beliefs, processes
from worlds.processes.services import answered

from semantic_slam.configuration import load_configuration
from semantic_slam.pipeline.offline import run_bag
from semantic_slam.ros.launching.node_set import RunOptions, node_set
from semantic_slam.ros.launching.processes import NodeProcesses

pytestmark = [pytest.mark.ros, pytest.mark.slow]

NUM_FRAMES = 10
TIMEOUT_S = 240.0
STEPS = (
    (Transition.TRANSITION_CONFIGURE, "inactive"),
    (Transition.TRANSITION_ACTIVATE, "active"),
    (Transition.TRANSITION_DEACTIVATE, "inactive"),
)


def wait_until(nodes: NodeProcesses, happened: Callable[[], bool]) -> None:
    give_up = time.monotonic() + TIMEOUT_S
    while not happened():
        nodes.check()
        assert time.monotonic() < give_up
        time.sleep(0.05)


def test_nodes_wait_for_their_transitions_replay_as_offline_and_end_well_when_shut_down(tmp_path: Path) -> None:
    nowhere = {"network": "nowhere.safetensors"}
    configuration = write_configuration(tmp_path / "configuration", perception=nowhere)
    bag = write_bag(tmp_path / "bag", place_entries("ranges", NUM_FRAMES))
    run_bag(bag, tmp_path / "offline", load_configuration(configuration))
    reference = beliefs(tmp_path / "offline")
    assert len(reference) == NUM_FRAMES
    options = RunOptions(record=str(tmp_path / "belief"), autostart=False)
    specs = node_set(bag, configuration, 0.0, options, has_tf2=False, has_stereo=True)
    rclpy.init()
    try:
        with processes(tmp_path) as nodes:
            for spec in specs:
                nodes.start(spec)
            node = rclpy.create_node("operator")

            def state(name: str) -> str:
                return str(answered(node, GetState, f"{name}/get_state", GetState.Request()).current_state.label)

            def change(name: str, transition: int) -> bool:
                request = ChangeState.Request(transition=Transition(id=transition))
                return bool(answered(node, ChangeState, f"{name}/change_state", request).success)

            names = [spec.name for spec in specs]
            assert {state(name) for name in names} == {"unconfigured"}
            assert not change("hypothesis_manager", Transition.TRANSITION_DEACTIVATE)
            for transition, reached in STEPS:
                if transition == Transition.TRANSITION_DEACTIVATE:
                    wait_until(nodes, lambda: nodes.exit_code("bag_player") == 0)  # active, they replay the bag
                    names = [name for name in names if nodes.exit_code(name) is None and name != "bag_recorder"]
                for name in names:
                    assert change(name, transition) and state(name) == reached
            for name in names:
                assert change(name, Transition.TRANSITION_INACTIVE_SHUTDOWN)
            wait_until(nodes, lambda: not nodes.pids())
            assert {nodes.exit_code(spec.name) for spec in specs} == {0}
            node.destroy_node()
        assert_same(beliefs(tmp_path / "belief"), reference)
    finally:
        rclpy.try_shutdown()
