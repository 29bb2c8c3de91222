"""Two robots at once in one ROS domain, each in a namespace: each believes what it does alone, and nothing crosses.

One drives through a park and estimates what its odometry always gets wrong; how that changes the motion travels with
the keyframe. The other one flies, and odometry's six, points and gravity reach its belief.
"""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from semantic_slam_lab.simulation.tables import T_BODY_CAMERA, Flight, table_tops
from worlds import same_beliefs
from worlds.bags.imported import read_bag
from worlds.bags.table_bag import in_space, with_imu, write_table_bag
from worlds.processes.node_runs import TIMEOUT_S, Replay, assert_same, beliefs, processes
from worlds.scenes.inertial import Imu

from semantic_slam.bag.reader import BagReader
from semantic_slam.configuration import Configuration, from_dict, to_dict
from semantic_slam.datasets import victoria_park_import
from semantic_slam.datasets.victoria_park import example_path, read_log
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.open_world.spatial.region import SpatialRegion
from semantic_slam.messages import topics
from semantic_slam.messages.node_status import HARDWARE_ID, namespace_of
from semantic_slam.messages.typestore import deserialize
from semantic_slam.pipeline.offline import run_bag
from semantic_slam.ros.launching.processes import NodeProcesses

pytestmark = [pytest.mark.ros, pytest.mark.slow]

NUM_DRIVEN, NUM_FLOWN = 10, 5
"""Keyframes of different numbers: a message of the other one would be of one that there is not."""
WITH_BIAS = {
    "association": "open",
    "semantic_model": {"kind": "none"},
    "open_world": {"iterate_updates": False, "min_range_m": 4.0, "max_range_m": 21.0, "field_of_view_rad": 3.1416},
    "odometry": {"estimate_bias": True, "sigma_clock_offset_s": 0.1},
    "initial_pose": {"mean": [0.0, 0.0, 0.0], "sigma": [0.01, 0.01, 0.001]},
    "pruning": {"max_hypotheses": 4},
}


@dataclass(frozen=True)
class Robot:
    """One robot: its bag, its nodes to be, and what the offline pipeline makes of the bag."""

    name: str
    replay: Replay
    offline_bag: Path

    def start(self, nodes: NodeProcesses) -> None:
        for spec in self.replay.specs():
            nodes.start(spec, [spec.executable, "--ros-args", "-r", f"__ns:=/{self.name}"])

    @property
    def live(self) -> list[HybridBelief]:
        return beliefs(self.replay.belief_bag)

    @property
    def offline(self) -> list[HybridBelief]:
        return beliefs(self.offline_bag)


def robot(name: str, folder: Path, configuration: Configuration, backends: int) -> Robot:
    """The robot whose bag is ``folder``/bag."""
    run_bag(folder / "bag", folder / "offline", configuration)
    written = folder / "configuration.yaml"
    written.write_text(json.dumps(to_dict(configuration)))
    return Robot(name, Replay(folder / "bag", written, folder / "live", backends), folder / "offline")


def driving(folder: Path) -> Robot:
    """Several odometry samples lie between its keyframes, which are not one arc together."""
    victoria_park_import.write_bag(read_log(example_path()), folder / "bag", 0.4, max_keyframes=NUM_DRIVEN)
    return robot("driving", folder, from_dict(WITH_BIAS), 2)


def flying(folder: Path) -> Robot:
    own = in_space()
    flight, region = Flight(keyframes=NUM_FLOWN, things=6), SpatialRegion.of(own.open_world)
    room = table_tops(flight, region, np.random.default_rng(5))
    write_table_bag(folder / "bag", with_imu(room, Imu(T_body_imu=T_BODY_CAMERA), np.random.default_rng(5)))
    return robot("flying", folder, own, 1)


@pytest.fixture(scope="module")
def robots(tmp_path_factory: pytest.TempPathFactory) -> tuple[Robot, Robot]:
    """The driving one and the flying one, whose replays have ended."""
    both = driving(tmp_path_factory.mktemp("driving")), flying(tmp_path_factory.mktemp("flying"))
    with processes(both[0].replay.out) as one, processes(both[1].replay.out) as other:
        for own, nodes in zip(both, (one, other), strict=True):
            own.start(nodes)
        for nodes in (one, other):
            nodes.wait("bag_recorder", TIMEOUT_S)
            nodes.wait("bag_player", TIMEOUT_S)
    return both


@pytest.mark.long
def test_nodes_and_offline_agree_on_a_drive_whose_odometry_is_biased(robots: tuple[Robot, Robot]) -> None:
    live, offline = robots[0].live, robots[0].offline
    assert len(live) == len(offline) == NUM_DRIVEN
    assert max(len(belief.hypothesis_ids) for belief in offline) > 1
    for ours, theirs in zip(live, offline, strict=True):
        same_beliefs.assert_same(ours, theirs)


def test_nodes_in_space_give_the_beliefs_of_the_offline_pipeline(robots: tuple[Robot, Robot]) -> None:
    flown = robots[1]
    assert flown.offline[-1].state_space == "spatial" and len(flown.offline) == NUM_FLOWN
    assert_same(flown.live, flown.offline)
    sent, *recorded = (
        len(read_bag(bag)["/imu"]) for bag in (flown.replay.bag, flown.offline_bag, flown.replay.belief_bag)
    )
    assert recorded == [sent, sent]


def test_each_recorder_hears_the_nodes_of_its_own_robot_alone(robots: tuple[Robot, Robot]) -> None:
    for own in robots:
        assert spoken_of(own.replay.belief_bag) == {f"/{own.name}"}


def spoken_of(bag: Path) -> set[str]:
    """Namespaces of the nodes whose diagnostics are in a bag."""
    with BagReader(bag) as reader:
        arrays = [deserialize(message.cdr, message.type_name) for message in reader.messages([topics.DIAGNOSTICS])]
    return {namespace_of(status) for array in arrays for status in array.status if status.hardware_id == HARDWARE_ID}
