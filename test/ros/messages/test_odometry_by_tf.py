"""Odometry that comes by /tf alone: what is picked out of its messages, and the node that passes it on, over DDS."""

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rclpy
from worlds.processes.node_runs import processes

from semantic_slam.errors import InputError
from semantic_slam.geometry.transform import compose
from semantic_slam.messages import topics
from semantic_slam.messages.sensor import TransformTree
from semantic_slam.messages.standard import header_stamp_ns, pose_vector
from semantic_slam.messages.tf_odometry import MOST_REMEMBERED, TfOdometry
from semantic_slam.messages.typestore import deserialize, serialize
from semantic_slam.pipeline.plain_views import transform_view
from semantic_slam.ros.launching.node_set import NodeSpec
from semantic_slam.ros.node.health import InputMonitor, Level, Status, transforms_status
from semantic_slam.ros.wire import qos
from semantic_slam.ros.wire.transport import Outlet, is_installed, receive, ros_type

FOOTPRINT_TO_BASE = np.array([0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0])
QUARTER_TURN = (0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5))
START_S = 240.0
SILENT = "odom -> base_link on /tf has been silent for"
PERIOD_NS = 100_000_000


def driven(index: int) -> np.ndarray:
    """(7,) pose of the footprint in odom: ahead by a metre each time, and turned left."""
    return np.array([float(index), 0.0, 0.0, *QUARTER_TURN])


def test_what_tf_lacks_is_named_with_what_it_has_until_it_is_there() -> None:
    fixed = TransformTree()
    odometry = TfOdometry("odom", "base_link", fixed)
    assert odometry.lack == "odom -> base_link but has nothing"
    moving = transform_view(PERIOD_NS, [("odom", "base_footprint", driven(1))])
    assert odometry.read(transform_view(PERIOD_NS, [("map", "odom", driven(0))])) == [] == odometry.read(moving)
    told = transforms_status(odometry.lack, InputMonitor(odometry.name, 0.0), 0.0)
    assert told.level == Level.WARN and "has map -> odom, odom -> base_footprint; name the frames" in told.message
    assert "base_frame, which has to be perception.base_frame" in told.message
    fixed.add(transform_view(0, [("base_footprint", "base_link", FOOTPRINT_TO_BASE)]))
    (estimate,) = odometry.read(moving)
    assert (estimate.stamp_ns, estimate.frame_id, estimate.child_frame_id) == (PERIOD_NS, "odom", "base_link")
    np.testing.assert_allclose(estimate.pose, compose(driven(1), FOOTPRINT_TO_BASE))
    assert odometry.lack == ""


def test_odometry_that_stops_is_said_to_be_silent_and_by_name() -> None:
    moving = InputMonitor("odom -> base_link on /tf", 0.0)
    moving.arrived(10.0)
    assert transforms_status("", moving, 12.0) == Status("odometry", Level.OK, "comes by /tf")
    silent = Status("odometry", Level.WARN, "odom -> base_link on /tf has been silent for 7 s")
    assert transforms_status("", moving, 17.0) == silent


def test_echoes_are_left_out_however_late_and_a_clock_that_was_set_back_goes_on() -> None:
    """The echo of each transform comes after the next one, or after the one after that, as by ``broadcast_odom``."""
    odometry = TfOdometry("odom", "base_link", TransformTree())

    def stamps(*indices: int) -> list[int]:
        told = (transform_view(index * PERIOD_NS, [("odom", "base_link", driven(index))]) for index in indices)
        return [estimate.stamp_ns // PERIOD_NS for message in told for estimate in odometry.read(message)]

    assert (stamps(1, 2, 1, 2, 3, 2, 4, 3, 4, 2), odometry.num_repeated) == ([1, 2, 3, 4], 6)
    further = range(5, 5 + MOST_REMEMBERED)
    assert stamps(*further) == [*further]
    assert (stamps(1, 2, 1, 3), odometry.num_repeated) == ([1, 2, 3], 7)


def test_a_package_that_is_missing_is_named_as_it_is_installed() -> None:
    with pytest.raises(InputError, match="package no_such_msgs is not installed; install ros-jazzy-no-such-msgs"):
        ros_type("no_such_msgs/msg/Thing")


@pytest.mark.long
@pytest.mark.ros
@pytest.mark.slow
def test_odometry_on_tf_becomes_topic_odom_once_for_each_stamp_and_is_missed_when_it_stops(tmp_path: Path) -> None:
    if not is_installed(topics.TYPES[topics.TF]):
        pytest.skip("tf2_msgs is not installed; install ros-jazzy-tf2-msgs")
    heard: list[Any] = []
    statuses: list[str] = []
    rclpy.init()
    try:
        with processes(tmp_path) as nodes:
            nodes.start(NodeSpec("tf_odometry_node", "tf_odometry", {"odom_frame": "odom"}))
            node = rclpy.create_node("driver")
            kind = topics.TYPES[topics.ODOMETRY]
            receive(node, topics.ODOMETRY, lambda data: heard.append(deserialize(data, kind)), qos.everything())
            receive(
                node,
                topics.DIAGNOSTICS,
                lambda data: statuses.extend(
                    status.message for status in deserialize(data, topics.TYPES[topics.DIAGNOSTICS]).status
                ),
                qos.everything(),
            )
            static = Outlet(node, topics.TF_STATIC, topics.TYPES[topics.TF_STATIC], qos.latched())
            moving = Outlet(node, topics.TF, topics.TYPES[topics.TF], qos.transforms())
            assert static.wait_for_readers(1, START_S) and moving.wait_for_readers(1, START_S)
            static.send(serialize(transform_view(0, [("base_footprint", "base_link", FOOTPRINT_TO_BASE)])))
            index, give_up = 0, time.monotonic() + START_S
            while len(heard) < 5 and time.monotonic() < give_up:
                nodes.check()
                index += 1
                for _ in range(2):  # as a broadcaster that is faster than its odometry
                    moving.send(
                        serialize(transform_view(index * PERIOD_NS, [("odom", "base_footprint", driven(index))]))
                    )
                moving.send(serialize(transform_view(index * PERIOD_NS, [("map", "odom", driven(0))])))
                rclpy.spin_once(node, timeout_sec=0.1)
            statuses.clear()
            while not any(SILENT in status for status in statuses) and time.monotonic() < give_up:
                moving.send(serialize(transform_view(index * PERIOD_NS, [("map", "odom", driven(0))])))
                rclpy.spin_once(node, timeout_sec=0.1)
            assert any(SILENT in status for status in statuses) and "receiving" in statuses  # anything on /tf
            node.destroy_node()
    finally:
        rclpy.try_shutdown()
    stamps = [header_stamp_ns(message) for message in heard]
    assert len(heard) >= 5 and stamps == sorted(set(stamps))
    for message in heard:
        expected = compose(driven(header_stamp_ns(message) // PERIOD_NS), FOOTPRINT_TO_BASE)
        np.testing.assert_allclose(pose_vector(message.pose.pose), expected, atol=1e-12)
        assert (message.header.frame_id, message.child_frame_id) == ("odom", "base_link")
        assert not np.any(message.pose.covariance)
