"""``python -m semantic_slam_lab.overload``: live nodes are sent more than they can use, or as much as they can.

Detections that tell places, and odometry, at ``--rate`` for ``--seconds``: a robot that drives in a circle among
objects, through the nodes classifier, hypothesis_manager and backend_0. A row every few seconds: detections sent, the
newest keyframe and how old it is when its belief comes, what the nodes have dropped of the detections, their memory.
"""

import argparse
import os
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import rclpy
from rclpy.node import Node

from semantic_slam.cli.exit_codes import CommandParser, run_main
from semantic_slam.errors import SemanticSlamError
from semantic_slam.geometry.arrays import Array
from semantic_slam.messages import topics
from semantic_slam.messages.codec import encode
from semantic_slam.messages.standard import OdometryEstimate
from semantic_slam.messages.typestore import deserialize
from semantic_slam.perception.frame import Detections
from semantic_slam.ros import qos
from semantic_slam.ros.node_set import NodeSpec
from semantic_slam.ros.processes import NodeProcesses, loopback_environment
from semantic_slam.ros.resumption import header_stamp_ns
from semantic_slam.ros.transport import Outlet, receive

CONFIGURED = {"semantic_model.kind": "none", "association": "open"}
NODES = (
    NodeSpec("hypothesis_manager_node", "hypothesis_manager", CONFIGURED),
    NodeSpec("backend_node", "backend_0"),
    NodeSpec("classifier_node", "classifier", CONFIGURED | {"has_images": False}),
)
RADIUS_M, SPEED_M_S = 2.0, 0.5
NUM_OBJECTS, OBJECTS_M = 12, 4.0
FARTHEST_M, HALF_VIEW_RAD = 5.0, 0.6
SIGMA_M, SIGMA_RAD = 0.05, 0.01
START_S, ROW_S, SPIN_S = 240.0, 5.0, 0.002
FASTER = "came faster"


class Listener:
    """What the nodes say: the newest keyframe, how late it was, and what was dropped of what was sent."""

    def __init__(self, node: Node) -> None:
        self.keyframe, self.late_s, self.latest_s = -1, 0.0, 0.0
        self._dropped: dict[str, int] = {}
        receive(node, topics.BELIEF, self._note, qos.everything())
        receive(node, topics.DIAGNOSTICS, self._count, qos.everything())

    @property
    def num_dropped(self) -> int:
        """Detections and measurements that came faster than they could be used."""
        return sum(self._dropped.values())

    def _note(self, data: bytes) -> None:
        self.keyframe = int(deserialize(data, topics.TYPES[topics.BELIEF]).keyframe)
        self.late_s = time.time() - header_stamp_ns(data) / 1e9
        self.latest_s = max(self.latest_s, self.late_s)

    def _count(self, data: bytes) -> None:
        for status in deserialize(data, topics.TYPES[topics.DIAGNOSTICS]).status:
            told = {f"{status.name} {own.key}": int(own.value) for own in status.values if FASTER in own.key}
            self._dropped.update(told)


def sent(at_s: float, stamp_ns: int, objects: Array, chance: np.random.Generator) -> Iterator[tuple[str, bytes]]:
    """Odometry and detections of an instant."""
    angle = SPEED_M_S * at_s / RADIUS_M
    position, heading = RADIUS_M * np.array([np.cos(angle), np.sin(angle)]), angle + np.pi / 2
    pose = np.array([*position, 0.0, 0.0, 0.0, np.sin(heading / 2), np.cos(heading / 2)])
    yield topics.ODOMETRY, encode(OdometryEstimate(stamp_ns, "odom", "base_link", pose, np.zeros((6, 6))))
    ahead = objects - position
    ranges = np.hypot(*ahead.T) + chance.normal(0.0, SIGMA_M, len(objects))
    bearings = np.arctan2(ahead[:, 1], ahead[:, 0]) - heading
    bearings = np.angle(np.exp(1j * bearings)) + chance.normal(0.0, SIGMA_RAD, len(objects))
    seen = (ranges < FARTHEST_M) & (np.abs(bearings) < HALF_VIEW_RAD)
    yield topics.DETECTIONS, encode(_detections(stamp_ns, ranges[seen], bearings[seen]))


def _detections(stamp_ns: int, ranges_m: Array, bearings_rad: Array) -> Detections:
    count = len(ranges_m)
    return Detections(
        stamp_ns=stamp_ns,
        frame_id="base_link",
        boxes=np.full((count, 4), np.nan),
        labels=("box",) * count,
        scores=np.full(count, 0.9),
        track_ids=("",) * count,
        ranges_m=ranges_m,
        bearings_rad=bearings_rad,
        elevations_rad=np.zeros(count),
        place_covariances=np.tile(np.diag([SIGMA_M**2, SIGMA_RAD**2, np.nan]), (count, 1, 1)),
    )


def resident_mb(pid: int) -> float:
    """Resident memory of a process."""
    pages = int(Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def command() -> None:
    parser = CommandParser("python -m semantic_slam_lab.overload", description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--rate", type=float, default=100.0, help="frames of detections per second")
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    domain_id = int(os.environ.get("ROS_DOMAIN_ID", "48"))
    rclpy.init(domain_id=domain_id)
    try:
        with TemporaryDirectory() as folder, NodeProcesses(Path(folder), loopback_environment(domain_id)) as nodes:
            for spec in NODES:
                nodes.start(spec)
            drive(rclpy.create_node("robot"), nodes, arguments)
    finally:
        rclpy.try_shutdown()


def drive(node: Node, nodes: NodeProcesses, arguments: argparse.Namespace) -> None:
    """Send all along, and print a row now and then. Raises SemanticSlamError where a node ends."""
    chance = np.random.default_rng(arguments.seed)
    objects = chance.uniform(-OBJECTS_M, OBJECTS_M, (NUM_OBJECTS, 2))
    listener = Listener(node)
    outlets = {
        topic: Outlet(node, topic, topics.TYPES[topic], qos.sensor_input(topic, lossless=False))
        for topic in (topics.ODOMETRY, topics.DETECTIONS)
    }
    if not all(outlet.wait_for_readers(1, START_S) for outlet in outlets.values()):
        raise SemanticSlamError("the nodes have not come up; see that nothing else runs in this ROS domain")
    print("   sent  keyframe  late s  dropped  " + "  ".join(f"{spec.name} MB" for spec in NODES))
    start_s, told_s, count = time.monotonic(), 0.0, 0
    while (at_s := time.monotonic() - start_s) < arguments.seconds:
        nodes.check()
        while count < at_s * arguments.rate:
            for topic, data in sent(count / arguments.rate, time.time_ns(), objects, chance):
                outlets[topic].send(data)
            count += 1
        rclpy.spin_once(node, timeout_sec=SPIN_S)
        if at_s - told_s > ROW_S:
            told_s = at_s
            memory = "  ".join(f"{resident_mb(pid):{len(name) + 3}.1f}" for name, pid in nodes.pids().items())
            row = f"{count:7d}  {listener.keyframe:8d}  {listener.late_s:6.2f}  {listener.num_dropped:7d}"
            print(f"{row}  {memory}", flush=True)
    print(
        f"latest belief {listener.latest_s:.2f} s after its stamp; {listener.keyframe + 1} keyframes of {count} frames"
    )


if __name__ == "__main__":
    run_main(command)
