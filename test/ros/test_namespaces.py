"""Two robots at once in one ROS domain, each in a namespace: each believes what it does alone, and nothing crosses."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest
from worlds.bag_factory import Entry, write_bag, write_configuration
from worlds.node_runs import TIMEOUT_S, Replay, assert_same, beliefs, processes
from worlds.places import place_entries

from semantic_slam.bag.reader import BagReader
from semantic_slam.configuration import load_configuration
from semantic_slam.messages import topics
from semantic_slam.messages.node_status import HARDWARE_ID, namespace_of
from semantic_slam.messages.typestore import deserialize
from semantic_slam.pipeline.offline import run_bag
from semantic_slam.ros.launching.processes import NodeProcesses

NUM_FRAMES = {"robot1": 12, "robot2": 9}
"""Drives of different lengths: a message of the other one would be of a keyframe that there is not."""
TOLD = {"robot1": "ranges", "robot2": "positions"}


@dataclass(frozen=True)
class Robot:
    """One robot, its bag, and its nodes."""

    name: str
    replay: Replay
    nodes: NodeProcesses

    def start(self) -> None:
        for spec in self.replay.specs():
            self.nodes.start(spec, [spec.executable, "--ros-args", "-r", f"__ns:=/{self.name}"])

    def wait(self) -> None:
        self.nodes.wait("bag_recorder", TIMEOUT_S)
        self.nodes.wait("bag_player", TIMEOUT_S)


@contextmanager
def robot(name: str, folder: Path, configuration: Path) -> Iterator[Robot]:
    """A robot whose nodes are ended at the end of the context."""
    bag = write_bag(folder / name / "bag", entries(name))
    with processes(folder / name) as nodes:
        yield Robot(name, Replay(bag, configuration, folder / name, backends=1), nodes)


def entries(name: str) -> list[Entry]:
    return place_entries(TOLD[name], NUM_FRAMES[name])


@pytest.mark.ros
@pytest.mark.slow
def test_two_robots_in_one_domain_believe_what_each_does_alone(tmp_path: Path) -> None:
    configuration = write_configuration(tmp_path / "configuration")
    with robot("robot1", tmp_path, configuration) as one, robot("robot2", tmp_path, configuration) as other:
        for own in (one, other):
            own.start()
        for own in (one, other):
            own.wait()
    for own in (one, other):
        run_bag(own.replay.bag, tmp_path / own.name / "offline", load_configuration(configuration))
        found = beliefs(own.replay.belief_bag)
        assert len(found) == NUM_FRAMES[own.name]
        assert_same(found, beliefs(tmp_path / own.name / "offline"))
        assert spoken_of(own.replay.belief_bag) == {f"/{own.name}"}


def spoken_of(bag: Path) -> set[str]:
    """Namespaces of the nodes whose diagnostics are in a bag."""
    with BagReader(bag) as reader:
        arrays = [deserialize(message.cdr, message.type_name) for message in reader.messages([topics.DIAGNOSTICS])]
    return {namespace_of(status) for array in arrays for status in array.status if status.hardware_id == HARDWARE_ID}
