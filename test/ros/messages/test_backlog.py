"""Of messages that come faster than they are worked on the newest wait, and the others are told apart."""

import time

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor

from semantic_slam.messages import topics
from semantic_slam.ros.node.backlog import Backlog
from semantic_slam.ros.node.pipeline_node import PipelineNode
from semantic_slam.ros.wire import qos
from semantic_slam.ros.wire.transport import Outlet

TIMEOUT_S = 120.0


def test_the_oldest_go_and_as_many_wait_as_may() -> None:
    backlog = Backlog(3)
    assert [backlog.add(bytes([n])) for n in range(5)] == [False, False, False, True, True]
    assert [backlog.take() for _ in range(3)] == [b"\x02", b"\x03", b"\x04"]
    assert not backlog.add(b"")


@pytest.mark.ros
def test_a_second_of_a_fast_sensor_waits_in_the_subscription_while_the_node_is_busy() -> None:
    """As for 1 s at 400 Hz; of pictures and detections 50 wait there."""
    rclpy.init()
    try:
        node, robot = PipelineNode("manager"), rclpy.create_node("robot")
        executor, taken = SingleThreadedExecutor(), list[bytes]()
        executor.add_node(node)
        node.is_active = True
        node.listen(topics.IMU, taken.append, qos.sensor_input(topics.IMU, lossless=False))
        said = Outlet(robot, topics.IMU, topics.TYPES[topics.IMU], qos.result(False))
        assert said.wait_for_readers(1, TIMEOUT_S)
        for _ in range(400):
            said.send(b"\x00\x01\x00\x00")  # nobody spins
        give_up = time.monotonic() + TIMEOUT_S
        while len(node._backlogs[topics.IMU]) < 400:
            assert time.monotonic() < give_up, len(node._backlogs[topics.IMU])
            executor.spin_once(timeout_sec=0.02)
        assert qos.sensor_input(topics.DETECTIONS, lossless=False).depth == 50
    finally:
        rclpy.try_shutdown()


@pytest.mark.ros
def test_a_node_that_is_told_to_end_says_what_it_has_not_used(capfd: pytest.CaptureFixture[str]) -> None:
    rclpy.init()
    try:
        node, robot = PipelineNode("manager"), rclpy.create_node("robot")
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        node.listen(topics.MEASUREMENTS, lambda _: None, qos.result(False))
        said = Outlet(robot, topics.MEASUREMENTS, topics.TYPES[topics.MEASUREMENTS], qos.result(False))
        assert said.wait_for_readers(1, TIMEOUT_S)
        node.say_left()
        assert capfd.readouterr().err == ""
        for _ in range(3):
            said.send(b"\x00\x01\x00\x00")  # nobody works on it, as the node is not active
        give_up = time.monotonic() + TIMEOUT_S
        while len(node._backlogs[topics.MEASUREMENTS]) < 3:
            assert time.monotonic() < give_up
            executor.spin_once(timeout_sec=0.02)
        node.say_left()
        (line,) = capfd.readouterr().err.splitlines()
        assert line.endswith(f"[manager]: ended before it had used 3 x {topics.MEASUREMENTS}")
    finally:
        rclpy.try_shutdown()
