"""``python -m semantic_slam_lab.overload``: live nodes are sent more than they can use, or as much as they can.

Detections that tell places, and odometry, at ``--rate`` for ``--seconds``: a robot that drives in a circle among
objects, through the nodes classifier, hypothesis_manager and backend_0. A row every few seconds: detections sent, the
newest keyframe and how old it is when its belief comes, what the nodes have dropped of the detections, their memory.
"""

import argparse
import os
import time
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import rclpy
from rclpy.node import Node

from semantic_slam.cli.exit_codes import CommandParser, run_main
from semantic_slam.errors import SemanticSlamError
from semantic_slam.messages import topics
from semantic_slam.pipeline.provenance import revision
from semantic_slam.ros.launching.node_set import NodeSpec
from semantic_slam.ros.launching.processes import NodeProcesses, loopback_environment
from semantic_slam.ros.wire import qos
from semantic_slam.ros.wire.transport import Outlet
from semantic_slam_lab.overload.listener import Listener
from semantic_slam_lab.overload.outcome import ROW_S, Row, check_seconds, claims_of, resident_mb, table_of
from semantic_slam_lab.overload.robot import NUM_OBJECTS, OBJECTS_M, sent
from semantic_slam_lab.studies.result import write_result

START_S, SPIN_S = 240.0, 0.002
QUIET_S, LONGEST_S = 5.0, 300.0
"""The nodes are done with what was sent once they tell nothing new for so long; and how long they are waited for."""


def node_specs(horizon: int) -> list[NodeSpec]:
    """The nodes of a robot without a map whose detections tell places."""
    configured = {"semantic_model.kind": "none", "association": "open", "history.horizon_keyframes": horizon}
    return [
        NodeSpec("hypothesis_manager_node", "hypothesis_manager", configured),
        NodeSpec("backend_node", "backend_0"),
        NodeSpec("classifier_node", "classifier", configured | {"has_images": False}),
    ]


def command() -> None:
    """Entry point. Raises InputError for a run that is too short, SemanticSlamError where a node ends."""
    parser = CommandParser("python -m semantic_slam_lab.overload", description=__doc__)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--rate", type=float, default=100.0, help="frames of detections per second")
    parser.add_argument("--horizon", type=int, default=0, help="history.horizon_keyframes; 0: off")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("out/overload"), help="default: %(default)s")
    arguments = parser.parse_args()
    check_seconds(arguments.seconds)
    specs = node_specs(arguments.horizon)
    domain_id = int(os.environ.get("ROS_DOMAIN_ID", "48"))
    rows = []
    rclpy.init(domain_id=domain_id)
    try:
        with TemporaryDirectory() as folder, NodeProcesses(Path(folder), loopback_environment(domain_id)) as nodes:
            for spec in specs:
                nodes.start(spec)
            for row in drive(rclpy.create_node("robot"), nodes, arguments):
                print(row.line, flush=True)
                rows.append(row)
    finally:
        rclpy.try_shutdown()
    for path in write_result(arguments.out, result_of(arguments, rows), claims_of(rows), [table_of(rows)]):
        print(path)


def drive(node: Node, nodes: NodeProcesses, arguments: argparse.Namespace) -> Iterator[Row]:
    """Send all along, and tell how it stands now and then, and when the nodes are done. Raises SemanticSlamError."""
    chance = np.random.default_rng(arguments.seed)
    objects = chance.uniform(-OBJECTS_M, OBJECTS_M, (NUM_OBJECTS, 2))
    listener = Listener(node)
    outlets = {
        topic: Outlet(node, topic, topics.TYPES[topic], qos.sensor_input(topic, lossless=False))
        for topic in (topics.ODOMETRY, topics.DETECTIONS)
    }
    if not all(outlet.wait_for_readers(1, START_S) for outlet in outlets.values()):
        raise SemanticSlamError("the nodes have not come up; see that nothing else runs in this ROS domain")
    print("   sent  keyframe  late s  dropped  " + "  ".join(f"{name} MB" for name in nodes.pids()))
    start_s, told_s, count = time.monotonic(), 0.0, 0

    def row(at_s: float) -> Row:
        memory = {name: resident_mb(pid) for name, pid in nodes.pids().items()}
        late_s, latest_s = listener.late_s, listener.take_latest_s()
        return Row(at_s, count, listener.keyframe, late_s, latest_s, listener.num_dropped, memory)

    while (at_s := time.monotonic() - start_s) < arguments.seconds:
        nodes.check()
        while count < at_s * arguments.rate:
            for topic, data in sent(count / arguments.rate, time.time_ns(), objects, chance):
                outlets[topic].send(data)
            count += 1
        rclpy.spin_once(node, timeout_sec=SPIN_S)
        if at_s - told_s > ROW_S:
            told_s = at_s
            yield row(at_s)
    end_s = told_s = time.monotonic() - start_s
    told = (listener.keyframe, listener.num_dropped)
    while (at_s := time.monotonic() - start_s) < min(told_s + QUIET_S, end_s + LONGEST_S):
        rclpy.spin_once(node, timeout_sec=SPIN_S)
        if told != (told := (listener.keyframe, listener.num_dropped)):
            told_s = at_s
    yield row(at_s)


def result_of(arguments: argparse.Namespace, rows: list[Row]) -> dict[str, Any]:
    """What is kept of a run."""
    return {
        "study": "overload",
        "quick": False,
        "seed": arguments.seed,
        "revision": revision(),
        "rate": arguments.rate,
        "seconds": arguments.seconds,
        "horizon": arguments.horizon,
        "results": [asdict(row) for row in rows],
    }


run_main(command)
