"""A robot that sends its odometry and detections to live nodes, each its own process over DDS, and hears beliefs."""

import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import rclpy
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger
from worlds.bags.bag_factory import PERIOD, Entry
from worlds.bags.places import place_entries
from worlds.processes.node_runs import processes
from worlds.processes.services import answered

from semantic_slam.errors import InputError
from semantic_slam.evaluation.belief_bag import read_record
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.messages import topics
from semantic_slam.messages.codec import decode
from semantic_slam.messages.standard import header_stamp_ns, time_message
from semantic_slam.messages.typestore import deserialize, serialize
from semantic_slam.ros.launching.node_set import NodeSpec
from semantic_slam.ros.launching.processes import NodeProcesses
from semantic_slam.ros.launching.supervisor import Supervisor
from semantic_slam.ros.wire import qos
from semantic_slam.ros.wire.transport import Outlet, receive

TIMEOUT_S = 240.0
"""Generous: on a loaded machine the processes take long to start, and to be matched by DDS."""
SENT = (topics.ODOMETRY, topics.DETECTIONS)


@dataclass
class Robot:
    """Nodes that run live, and the test's own node that publishes to them and hears their beliefs."""

    nodes: NodeProcesses
    node: Node
    heard: list[int] = field(default_factory=list)  # keyframe indices of beliefs
    told: dict[int, HybridBelief] = field(default_factory=dict)  # keyframe index -> newest belief of it

    def __post_init__(self) -> None:
        self.outlets = {topic: Outlet(self.node, topic, topics.TYPES[topic], qos.everything()) for topic in SENT}
        receive(self.node, topics.BELIEF, self._hear, qos.everything())

    def _hear(self, data: bytes) -> None:
        belief: HybridBelief = decode(data, topics.TYPES[topics.BELIEF])
        self.heard.append(belief.keyframe)
        self.told[belief.keyframe] = belief

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
        assert all(outlet.wait_for_readers(1, TIMEOUT_S) for outlet in self.outlets.values())
        self.ask(SetBool, "pause", SetBool.Request(data=False))  # the manager is there
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
        self.told.clear()

    def send_until_heard(self, entries: Iterable[Entry], *, after: int) -> int:
        """Send one after the other until there is a belief of a keyframe after this one; its index."""
        self.send_until(entries, lambda: any(keyframe > after for keyframe in self.heard))
        return next(keyframe for keyframe in self.heard if keyframe > after)

    def send_until(self, entries: Iterable[Entry], holds: Callable[[], bool]) -> None:
        """Send one after the other until a condition holds."""
        for entry in entries:
            self.send([entry])
            self.spin(0.3)
            self.nodes.check()
            if holds():
                return
        raise AssertionError(f"all is sent; heard {self.heard}")

    def spin_until(self, holds: Callable[[], bool]) -> None:
        """Spin until a condition holds."""
        give_up = time.monotonic() + TIMEOUT_S
        while not holds():
            self.spin(0.3)
            self.nodes.check()
            assert time.monotonic() < give_up

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


@contextmanager
def robot_among(folder: Path, specs: list[NodeSpec]) -> Iterator[Robot]:
    """A robot that all nodes hear, which a supervisor keeps alive; their logs are below ``folder``."""
    rclpy.init()
    try:
        with processes(folder, Supervisor(specs)) as nodes:
            for spec in specs:
                nodes.start(spec)
            robot = Robot(nodes, rclpy.create_node("robot"))
            robot.warm_up()
            yield robot
            robot.node.destroy_node()
    finally:
        rclpy.try_shutdown()


def recorded(bag: Path) -> list[int]:
    """Keyframe indices in a belief bag, which may still be written, or not be there yet."""
    try:
        return [belief.keyframe for belief in read_record(bag).beliefs]
    except InputError:
        return []


def later(entries: list[Entry], periods: int) -> list[Entry]:
    """The same, so much later."""
    moved = []
    for entry in entries:
        message = deserialize(serialize(entry.message), topics.TYPES[entry.topic]) if entry.topic in SENT else None
        if message is not None:
            message.header.stamp = time_message(header_stamp_ns(message) + periods * PERIOD)
            moved.append(replace(entry, message=message))
    return moved
