"""Running nodes through several sessions: a pause, a bag that is played again, a reset, another map."""

import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pytest
import rclpy
from rclpy.node import Node
from semantic_slam_msgs.srv import Explain, LoadMap, SaveMap
from std_srvs.srv import SetBool, Trigger
from worlds.bags.bag_factory import PERIOD, Entry, write_bag, write_configuration
from worlds.bags.places import place_entries
from worlds.processes.node_runs import assert_same, beliefs, processes
from worlds.processes.services import answered

from semantic_slam.configuration import load_configuration
from semantic_slam.evaluation.belief_bag import read_record
from semantic_slam.messages import topics
from semantic_slam.messages.standard import header_stamp_ns, time_message
from semantic_slam.messages.typestore import deserialize, serialize
from semantic_slam.pipeline.offline import run_bag
from semantic_slam.ros.launching.node_set import NodeSpec
from semantic_slam.ros.launching.processes import NodeProcesses
from semantic_slam.ros.launching.supervisor import Supervisor
from semantic_slam.ros.node.parameters import changed_parameters
from semantic_slam.ros.wire import qos
from semantic_slam.ros.wire.transport import Outlet, receive

pytestmark = [pytest.mark.ros, pytest.mark.slow]

NUM_FRAMES = 6
PATIENCE_FRAMES = 80
"""Until a manager that is started again hears what is sent, which on a busy machine takes long."""
TIMEOUT_S = 60.0
SENT = (topics.ODOMETRY, topics.DETECTIONS)


@dataclass
class Robot:
    """Nodes that run live, and the test's own node that publishes to them and hears their beliefs."""

    nodes: NodeProcesses
    node: Node
    folder: Path
    heard: list[int] = field(default_factory=list)  # keyframe indices of beliefs

    def __post_init__(self) -> None:
        self.outlets = {topic: Outlet(self.node, topic, topics.TYPES[topic], qos.everything()) for topic in SENT}
        receive(self.node, topics.BELIEF, self._hear, qos.everything())

    def _hear(self, data: bytes) -> None:
        self.heard.append(keyframe_of(data))

    def spin(self, seconds: float) -> None:
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            rclpy.spin_once(self.node, timeout_sec=0.02)

    def send(self, entries: list[Entry]) -> None:
        for entry in entries:
            if entry.topic in SENT:
                self.outlets[entry.topic].send(serialize(entry.message))
                self.spin(0.02)

    def warm_up(self) -> None:
        """A first run, until every node hears the others: what is sent before that may be lost."""
        entries, give_up = place_entries("ranges", 1), time.monotonic() + TIMEOUT_S
        for number in range(1000):
            self.send(later(entries, number - 1000))
            if self.heard:
                break
            self.spin(0.2)
            assert time.monotonic() < give_up
        known = 0
        while known < len(self.heard):  # what is on its way belongs to this run
            known = len(self.heard)
            self.spin(2.0)
            assert time.monotonic() < give_up
        self.ask(Trigger, "reset", Trigger.Request())
        self.heard.clear()

    def frames_until_heard(self, entries: list[Entry]) -> int:
        """Send one after the other until there is a belief of another keyframe; its index."""
        known = set(self.heard)
        for entry in entries:
            self.send([entry])
            self.spin(0.3)
            self.nodes.check()
            if new := set(self.heard) - known - set(range(NUM_FRAMES)):
                return min(new)
        raise AssertionError(f"no belief of another keyframe; heard {self.heard}")

    def wait_for(self, expected: list[int]) -> None:
        """Until exactly these beliefs were heard, and forget them."""
        give_up = time.monotonic() + TIMEOUT_S
        while self.heard != expected and time.monotonic() < give_up:
            self.nodes.check()
            self.spin(0.1)
            assert self.heard == expected[: len(self.heard)]
        assert self.heard == expected
        self.heard.clear()

    def ask(self, kind: Any, name: str, request: Any) -> Any:
        return answered(self.node, kind, f"/hypothesis_manager/{name}", request)


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[Robot]:
    nowhere = {"network": "nowhere.safetensors"}
    configuration = load_configuration(write_configuration(tmp_path / "configuration", perception=nowhere))
    write_bag(tmp_path / "bag", place_entries("ranges", NUM_FRAMES))
    run_bag(tmp_path / "bag", tmp_path / "offline", configuration)
    configured, prior = changed_parameters(configuration), str(tmp_path / "bag" / "objects.json")
    manager = configured | {"backends": 1, "map_prior": prior, "journal": str(tmp_path / "journal")}
    specs = [
        NodeSpec("bag_recorder", "bag_recorder", {"bag": str(tmp_path / "belief")}),
        NodeSpec("hypothesis_manager_node", "hypothesis_manager", manager),
        NodeSpec("backend_node", "backend_0"),
        NodeSpec("classifier_node", "classifier", configured | {"has_images": False}),
    ]
    rclpy.init()
    try:
        with processes(tmp_path, Supervisor(specs)) as nodes:
            for spec in specs:
                nodes.start(spec)
            robot = Robot(nodes, rclpy.create_node("robot"), tmp_path)
            assert all(outlet.wait_for_readers(1, TIMEOUT_S) for outlet in robot.outlets.values())
            robot.ask(SetBool, "pause", SetBool.Request(data=False))  # the manager is there
            robot.warm_up()
            yield robot
            robot.node.destroy_node()
    finally:
        rclpy.try_shutdown()


def later(entries: list[Entry], periods: int) -> list[Entry]:
    """The same, so much later."""
    moved = []
    for entry in entries:
        message = deserialize(serialize(entry.message), topics.TYPES[entry.topic]) if entry.topic in SENT else None
        if message is not None:
            message.header.stamp = time_message(header_stamp_ns(message) + periods * PERIOD)
            moved.append(replace(entry, message=message))
    return moved


def test_a_robot_that_lives_through_sessions_records_each_as_a_bag_of_its_own(robot: Robot) -> None:
    entries = place_entries("ranges", NUM_FRAMES)
    whole = list(range(NUM_FRAMES))
    robot.send(entries)
    robot.wait_for(whole)

    robot.send(entries)  # a second recording: its clock is set back
    robot.wait_for(whole)

    said = robot.ask(Trigger, "reset", Trigger.Request())
    assert said.success and "keyframe 0" in said.message
    next_entries, half = later(entries, NUM_FRAMES), 1 + len(SENT) * (NUM_FRAMES // 2)
    robot.send(next_entries[:half])
    robot.wait_for(whole[: NUM_FRAMES // 2])
    assert robot.ask(SetBool, "pause", SetBool.Request(data=True)).success
    robot.send(next_entries[half:-2])
    robot.spin(2.0)  # what is on its way belongs to the pause
    assert robot.ask(SetBool, "pause", SetBool.Request(data=False)).message == "keyframes are made"
    robot.send(next_entries[-2:])
    robot.wait_for([NUM_FRAMES // 2])

    missing = robot.ask(LoadMap, "load_map", LoadMap.Request(path=str(robot.folder / "none.json")))
    assert "none.json" in missing.fault and robot.heard == []
    path = str(robot.folder / "room.map")
    saved = robot.ask(SaveMap, "save_map", SaveMap.Request(path=path))
    loaded = robot.ask(LoadMap, "load_map", LoadMap.Request(path=path))
    assert (saved.fault, loaded.fault, loaded.objects, loaded.map_id) == ("", "", 2, saved.map_id)
    robot.send(later(entries, 2 * NUM_FRAMES))
    robot.wait_for(whole)

    robot.nodes.kill("hypothesis_manager")  # its journal knows of all that, and which session it stands in
    again = robot.frames_until_heard(
        later(place_entries("ranges", PATIENCE_FRAMES), 2 * NUM_FRAMES)[len(next_entries) :]
    )
    assert again == NUM_FRAMES
    told = robot.ask(Explain, "explain", Explain.Request(object_id=1))
    assert told.fault == "" and told.explanation.splitlines()[-1].startswith("Inferred again: as recorded")

    robot.nodes.stop()
    assert [robot.nodes.exit_code(name) for name in ("bag_recorder", "hypothesis_manager", "backend_0")] == [0, 0, 0]
    reference = beliefs(robot.folder / "offline")
    bags = [robot.folder / name for name in ("belief_2", "belief_3", "belief_4", "belief_5")]
    for bag in bags[:2]:
        assert_same(beliefs(bag), reference)
    records = [read_record(bag) for bag in bags]
    assert [len(record.beliefs) for record in records[:3]] == [NUM_FRAMES, NUM_FRAMES, NUM_FRAMES // 2 + 1]
    ids = [record.run.run_id.partition(".") for record in records]
    assert [number for _, _, number in ids] == ["1", "2", "3", "4"]
    assert ids[0][0] == ids[1][0] == ids[2][0] != ids[3][0]  # the same but on another map


def keyframe_of(belief: bytes) -> int:
    return int(deserialize(belief, topics.TYPES[topics.BELIEF]).keyframe)
