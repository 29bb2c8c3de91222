"""The doctor looks at a running system: at what is published, how, and at who should answer."""

import json
import os
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
import yaml
from rclpy.qos import QoSProfile, ReliabilityPolicy
from worlds.bags.bag_factory import T_BASE_CAMERA, Entry, input_entries, of_topic
from worlds.processes.installed import ROOT
from worlds.processes.node_runs import processes

from semantic_slam.bag.mcap_stream import RawMessage
from semantic_slam.bag.names import absolute
from semantic_slam.configuration import from_dict
from semantic_slam.doctor.checks import graph as graph_checks
from semantic_slam.doctor.finding import Finding
from semantic_slam.doctor.graph import Endpoint, Graph, Said
from semantic_slam.doctor.input_summary import InputSummary
from semantic_slam.errors import InputError
from semantic_slam.messages import topics
from semantic_slam.messages.codec import to_message
from semantic_slam.messages.standard import NANOSECONDS, PoseEstimate, time_message
from semantic_slam.messages.typestore import serialize
from semantic_slam.pipeline.input_topics import offered
from semantic_slam.pipeline.preamble import Preamble
from semantic_slam.ros.launching.node_set import NodeSpec
from semantic_slam.ros.observers import examination, observation
from semantic_slam.ros.wire import qos
from semantic_slam.ros.wire.transport import ros_type

SENT = (topics.ODOMETRY, topics.CAMERA_INFO, topics.IMAGE_COMPRESSED, topics.DETECTIONS)
PERIOD_S = 0.1
START_S = 240.0
TURN = 12
FIRST_DOMAIN, DOMAINS = 215, 16
"""Above the ports that Linux gives to others, and above all domains of test/conftest.py."""


@pytest.fixture(autouse=True)
def _nobody_else(monkeypatch: pytest.MonkeyPatch) -> None:
    """A domain beside this worker's: what other tests leave there is nothing to the doctor."""
    own = FIRST_DOMAIN + int(os.environ["ROS_DOMAIN_ID"]) % DOMAINS
    monkeypatch.setenv("ROS_DOMAIN_ID", str(own))


@contextmanager
def drivers(late_s: float = 0.0, left_out: tuple[str, ...] = ()) -> Iterator[Any]:
    """A camera, a detector and odometry, ten times a second; stamps of odometry lie back by so much."""
    rclpy.init()
    node = rclpy.create_node("drivers")
    profile = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
    entries = input_entries(num_frames=TURN, with_depth=False)
    sent = [topic for topic in SENT if topic not in left_out]
    publishers = {topic: node.create_publisher(ros_type(topics.TYPES[topic]), topic, profile) for topic in sent}
    streams = {topic: of_topic(entries, topic) for topic in sent}
    ended = threading.Event()

    def drive() -> None:
        k = 0
        while not ended.wait(PERIOD_S):
            now_ns = node.get_clock().now().nanoseconds
            for topic in sent:
                send(
                    publishers[topic],
                    streams[topic][there_and_back(k)],
                    now_ns,
                    late_s if topic == topics.ODOMETRY else 0.0,
                )
            k += 1

    thread = threading.Thread(target=drive)
    thread.start()
    try:
        yield node
    finally:
        ended.set()
        thread.join()
        node.destroy_node()
        rclpy.try_shutdown()


def there_and_back(k: int) -> int:
    return min(k % (2 * TURN - 2), -k % (2 * TURN - 2))


def send(publisher: Any, entry: Entry, now_ns: int, late_s: float) -> None:
    entry.message.header.stamp = time_message(now_ns - round(late_s * NANOSECONDS))
    publisher.publish(serialize(entry.message))


def configuration(folder: Path) -> Path:
    path = folder / "mine.yaml"
    values = {"association": "open", "semantic_model": {"kind": "none"}}
    path.write_text(json.dumps({**values, "perception": {"extrinsics": T_BASE_CAMERA.tolist()}}))
    return path


def pose_in(frame_id: str) -> Any:
    """Message of a pose at the origin of a frame."""
    return to_message(PoseEstimate(1, frame_id, np.array([0.0, 0, 0, 0, 0, 0, 1]), np.eye(6)))


def lines(found: list[Finding]) -> list[str]:
    return [finding.line for finding in found]


@pytest.mark.ros
@pytest.mark.slow
def test_drivers_that_fit_together_are_healthy_before_the_start(tmp_path: Path) -> None:
    with drivers():
        assert lines(examination.examine_running_system(configuration(tmp_path), None, 2.0)) == []


@pytest.mark.long
@pytest.mark.ros
@pytest.mark.slow
def test_a_manager_alone_with_drivers_that_do_not_fit_is_told_what_it_lacks(tmp_path: Path) -> None:
    """A lossless manager without a map or a backend; odometry is best effort and half a minute old.

    The manager's map is that of robot1, and the pose is given in the map of another robot.
    """
    with processes(tmp_path) as nodes, drivers(late_s=30.0, left_out=(topics.DETECTIONS,)) as node:
        parameters = {"lossless": True, "map_frame": "robot1/map"}
        nodes.start(NodeSpec("hypothesis_manager_node", "hypothesis_manager", parameters))
        pose = ros_type(topics.TYPES[topics.INITIAL_POSE])
        node.create_publisher(pose, topics.INITIAL_POSE, qos.latched()).publish(serialize(pose_in("robot2/map")))
        give_up = time.monotonic() + START_S
        while "hypothesis_manager" not in node.get_node_names() and time.monotonic() < give_up:
            nodes.check()
            time.sleep(0.05)
        found = lines(examination.examine_running_system(None, None, 2.0))
    print(found)
    for check, *words in (
        ("quality of service", "/odom: drivers publishes best effort", "publish it RELIABLE"),
        ("nodes", "hypothesis_manager runs and no backend answers", "backend_node"),
        ("nodes", "nobody publishes /classifier/measurements", "classifier_node"),
        ("topics", "no topic detections", "start its publisher, or remap it"),
        ("clocks", "/odom: stamped 30.0 s early", "use_sim_time"),
        ("initial pose", "it is in 'robot2/map'", "publish it in 'robot1/map'"),
    ):
        assert any(line.startswith(f"error: {check}: ") and all(word in line for word in words) for line in found)


@pytest.mark.ros
@pytest.mark.slow
def test_pictures_that_are_too_many_are_left_out_with_a_warning_and_the_rest_is_heard(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(observation, "MOST_BYTES", 20_000)
    with drivers():
        found = lines(examination.examine_running_system(configuration(tmp_path), None, 1.0))
    assert len(found) == 1, found
    assert found[0].startswith("warning: pictures: ") and "of /image/compressed are left out" in found[0]


@pytest.mark.ros
@pytest.mark.slow
def test_a_clock_that_is_found_late_costs_no_initial_pose(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(observation, "LEAST_S", 1.0)
    monkeypatch.setattr(observation, "EMPTY_S", 1.0)
    with drivers() as node, observation.observer([]) as look:
        pose = ros_type(topics.TYPES[topics.INITIAL_POSE])
        node.create_publisher(pose, topics.INITIAL_POSE, qos.latched()).publish(pose())
        give_up = time.monotonic() + START_S
        while not look.heard[absolute(topics.INITIAL_POSE)] and time.monotonic() < give_up:
            look.observe(0.5, examination.wanted)
        node.create_publisher(ros_type(topics.TYPES[topics.CLOCK]), topics.CLOCK, qos.newest())
        look.observe(0.5, lambda graph: {})
    arrivals = {message.topic: message.stamp_ns for message in look.messages[::-1]}
    assert arrivals.pop(absolute(topics.INITIAL_POSE)) > 0
    assert arrivals and set(arrivals.values()) == {0}  # the clock stands


@pytest.mark.parametrize(
    ("map_frame", "stated", "is_taken"),
    [
        ("robot1/map", "robot1/map", True),
        ("robot1/map", "map", False),
        ("", "map", True),
        ("", "robot1/map", True),
        ("", "odom", False),
    ],
)
def test_an_initial_pose_is_in_the_managers_map_frame_or_without_one_in_any_map(
    map_frame: str, stated: str, is_taken: bool
) -> None:
    topic = absolute(topics.INITIAL_POSE)
    message = RawMessage(topic, topics.TYPES[topics.INITIAL_POSE], 1, serialize(pose_in(stated)))
    preamble = Preamble()
    faults = examination.fill_preamble(preamble, [message], map_frame)
    assert (preamble.initial_pose is not None, len(faults)) == (is_taken, 1 - is_taken)


def test_a_map_that_cannot_be_read_ends_it_where_it_was_named_and_is_a_finding_of_the_manager(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.map"):
        examination.examine_running_system(None, tmp_path / "none.map", 1.0)
    (tmp_path / "torn.map").write_bytes(bytes(20))
    prior, found = examination.prior_of_manager(str(tmp_path / "torn.map"))
    assert prior is None and [line.split(": ")[1] for line in lines(found)] == ["map prior"]
    assert examination.prior_of_manager("") == (None, [])


def test_a_pose_that_is_clicked_in_rviz_reaches_the_manager() -> None:
    tools = yaml.safe_load((ROOT / "config" / "semantic_slam.rviz").read_text())["Visualization Manager"]["Tools"]
    told = next(tool["Topic"] for tool in tools if tool["Class"].endswith("SetInitialPose"))
    assert (
        told["Durability Policy"].upper().replace(" ", "_")
        == qos.sensor_input(topics.INITIAL_POSE, False).durability.name
    )


def test_quality_of_service_that_cannot_match_is_found_from_both_ends() -> None:
    detections, static = "semantic_slam_msgs/msg/DetectionArray", "tf2_msgs/msg/TFMessage"
    pose = "geometry_msgs/msg/PoseWithCovarianceStamped"
    graph = Graph(
        publishers={
            "/detections": [Endpoint("detector", detections, is_reliable=False)],
            "/tf_static": [Endpoint("mount", static)],
            "/initialpose": [Endpoint("rviz", pose)],
        },
        readers={
            "/detections": [Endpoint("classifier", detections), Endpoint("view", detections, is_reliable=False)],
            "/tf_static": [Endpoint("classifier", static, is_latched=True)],
            "/initialpose": [Endpoint("hypothesis_manager", pose, is_latched=True)],
        },
        nodes=frozenset(),
        said=[
            Said(2, "classifier: input /odom", "/odom is silent: no message so far; remap the topic"),
            Said(0, "a", "b"),
        ],
    )
    found = lines(list(graph_checks.check(graph)))
    assert [line.split(": ")[1] for line in found] == ["quality of service"] * 3 + ["classifier"]
    assert "detector publishes best effort and classifier wants it reliable" in found[0]
    assert (
        found[1].startswith("warning: ") and "publish /initialpose TRANSIENT_LOCAL" in found[1]
    )  # a run starts without
    assert found[2].startswith("error: ") and "publish /tf_static TRANSIENT_LOCAL" in found[2]
    assert found[3].endswith("; remap the topic")


def test_a_manager_that_was_not_told_of_the_inertial_sensor_is_named() -> None:
    space = from_dict({"state_space": "spatial", "observation": "points", "association": "open"})
    types = {"/imu": topics.TYPES[topics.IMU]}
    summary = InputSummary(
        configuration=space, prior=None, types=types, counts={}, found=offered(types), preamble=Preamble()
    )
    (found,) = examination.unread_imu(summary, {"has_imu": False})
    assert "/imu is published and hypothesis_manager does not listen to it; start" in found.line
    assert "-p has_imu:=true" in found.remedy
    assert list(examination.unread_imu(summary, {"has_imu": True})) == []
    assert list(examination.unread_imu(replace(summary, configuration=from_dict({})), {"has_imu": False})) == []


def test_a_type_that_is_not_installed_is_an_error_only_where_it_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(examination, "is_installed", lambda name: not name.startswith("stereo_msgs"))
    heard = Counter[str]()
    for other, number in ((topics.DEPTH_COMPRESSED, 0), (topics.DEPTH, 0), (topics.DETECTIONS, 1)):
        kinds = {f"/{topic}": topics.TYPES[topic] for topic in (topics.IMAGE, topics.DISPARITY, other)}
        publishers = {topic: [Endpoint("camera", kind)] for topic, kind in kinds.items()}
        graph = Graph(publishers=publishers, readers={}, nodes=frozenset())
        found = lines(list(examination.unheard(graph, heard)))
        assert len(found) == number == heard["/disparity"], other
        assert topics.DISPARITY not in examination.wanted(graph)
    assert "install ros-jazzy-stereo-msgs, or publish depth images" in found[0]


def test_types_that_differ_and_nodes_that_lack_are_found_before_the_start() -> None:
    theirs, ours = "vision_msgs/msg/Detection2DArray", "semantic_slam_msgs/msg/DetectionArray"
    graph = Graph(
        publishers={"/detections": [Endpoint("detector", theirs)]},
        readers={"/detections": [Endpoint("classifier", ours)]},
        nodes=frozenset({"classifier"}),
    )
    found = lines(list(graph_checks.check(graph)))
    assert [line.split(": ")[1] for line in found] == ["types", "nodes"]
    assert f"detector publishes {theirs} and classifier reads {ours}; remap one of them" in found[0]
    assert "no hypothesis_manager takes its measurements; start it" in found[1]
