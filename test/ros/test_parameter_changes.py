"""Parameters that are set while nodes run: what may change does, also after a restart; all else is refused."""

import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import rclpy
from rcl_interfaces.srv import GetParameters, SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter
from worlds.bags.bag_factory import write_bag, write_configuration
from worlds.bags.places import place_entries
from worlds.processes.node_runs import beliefs, processes
from worlds.processes.services import answered

from semantic_slam.errors import InputError
from semantic_slam.ros.bag_player import BagPlayer, Pace
from semantic_slam.ros.launching.node_set import RunOptions, node_set
from semantic_slam.ros.launching.processes import NodeProcesses

NUM_FRAMES = 8
TIMEOUT_S, TRIES = 240.0, 20
MANAGER, PLAYER = "hypothesis_manager", "bag_player"
FAR_APART = {"keyframes.policy": "odometry", "keyframes.distance_m": 100, "keyframes.angle_rad": 3.0}


class Operator:
    """Sets and reads parameters of other nodes."""

    def __init__(self, node: Node) -> None:
        self._node = node

    def set(self, name: str, parameter: str, value: Any) -> str:
        """Set a parameter of a node; why it was refused, "" if it was not."""
        request = SetParameters.Request(parameters=[Parameter(parameter, value=value).to_parameter_msg()])
        (result,) = answered(self._node, SetParameters, f"{name}/set_parameters", request, TRIES).results
        assert result.successful != bool(result.reason)
        return str(result.reason)

    def text(self, name: str, parameter: str) -> str:
        request = GetParameters.Request(names=[parameter])
        return str(answered(self._node, GetParameters, f"{name}/get_parameters", request, TRIES).values[0].string_value)


@pytest.fixture
def operator() -> Iterator[Operator]:
    rclpy.init()
    try:
        node = rclpy.create_node("operator")
        yield Operator(node)
        node.destroy_node()
    finally:
        rclpy.try_shutdown()


def wait_for_end(nodes: NodeProcesses, name: str) -> None:
    give_up = time.monotonic() + TIMEOUT_S
    while nodes.exit_code(name) is None:
        nodes.check()
        assert time.monotonic() < give_up
        time.sleep(0.05)


@pytest.mark.long
@pytest.mark.ros
@pytest.mark.slow
def test_what_may_change_in_a_run_does_and_survives_a_restart_and_all_else_is_refused(
    tmp_path: Path, operator: Operator
) -> None:
    configuration = write_configuration(tmp_path / "configuration", perception={"network": "nowhere.safetensors"})
    bag, belief = write_bag(tmp_path / "bag", place_entries("ranges", NUM_FRAMES)), tmp_path / "belief"
    journal = str(tmp_path / "journal")
    options = RunOptions(record=str(belief), journal=journal)
    *others, player = node_set(bag, configuration, 0.0, options, has_tf2=False, has_stereo=True)
    with processes(tmp_path) as nodes:
        for spec in others:
            nodes.start(spec)
        assert "read-only" in operator.set(MANAGER, "pruning.ratio", 10.0)
        assert "out of range" in operator.set(MANAGER, "keyframes.distance_m", -1.0)
        assert "start again with it" in operator.set(MANAGER, "open_world.time_budget_ms", 20.0)
        assert "positive number" in operator.set(MANAGER, "backend_timeout_s", 0.0)
        for name, value in {**FAR_APART, "backend_timeout_s": 90, "broadcast_odom": True}.items():
            assert not operator.set(MANAGER, name, value)
        nodes.start(player)
        wait_for_end(nodes, PLAYER)
        wait_for_end(nodes, "bag_recorder")
        assert len(beliefs(belief)) == 1, "the first frame alone, as set before the bag was played"
        nodes.kill(MANAGER)
        nodes.start(others[0].anew())
        give_up = time.monotonic() + TIMEOUT_S
        while operator.text(MANAGER, "keyframes.policy") != "odometry":
            assert time.monotonic() < give_up
            time.sleep(0.1)


@pytest.mark.long
@pytest.mark.ros
@pytest.mark.slow
def test_a_bag_that_is_played_slowly_is_played_faster_when_told_so(tmp_path: Path, operator: Operator) -> None:
    configuration = write_configuration(tmp_path / "configuration", perception={"network": "nowhere.safetensors"})
    bag = write_bag(tmp_path / "bag", place_entries("ranges", NUM_FRAMES))
    with processes(tmp_path) as nodes:
        for spec in node_set(bag, configuration, 1e-3, RunOptions(), has_tf2=False, has_stereo=True):
            nodes.start(spec)
        assert "lock-step" in operator.set(PLAYER, "rate", 0.0)
        assert "give a number" in operator.set(PLAYER, "rate", "fast")
        assert nodes.exit_code(PLAYER) is None
        assert not operator.set(PLAYER, "rate", 100)
        wait_for_end(nodes, PLAYER)
        assert nodes.exit_code(PLAYER) == 0


@pytest.mark.parametrize("rate", ["-1.0", "-1", ".nan", ".inf", "-0.001"])
def test_a_rate_that_is_none_is_refused_when_the_player_starts(rate: str) -> None:
    rclpy.init(args=["--ros-args", "-p", f"rate:={rate}", "-p", "bag:=nowhere"])
    try:
        with pytest.raises(InputError, match=r"^(bag_player: parameter rate is -.*; give 0|.* give a number$)"):
            BagPlayer()
    finally:
        rclpy.try_shutdown()


def test_messages_are_due_by_their_stamps_at_the_rate_of_the_moment() -> None:
    pace, since = Pace(10.0), time.monotonic()
    pace.wait(5_000_000_000)
    assert time.monotonic() - since < 0.1
    pace.wait(7_000_000_000)
    assert time.monotonic() - since >= 0.2
    pace.change(1e6)
    pace.wait(1_000_000_000_000)
    assert time.monotonic() - since < 10.0


def test_after_a_slow_stretch_messages_come_at_the_new_rate_and_not_all_at_once() -> None:
    pace, second = Pace(1e-3), 1_000_000_000
    pace.wait(0)
    timer = threading.Timer(0.5, pace.change, [5.0])
    timer.start()
    pace.wait(1 * second)
    since = time.monotonic()
    pace.wait(3 * second)
    assert time.monotonic() - since >= 0.35
    timer.join()
