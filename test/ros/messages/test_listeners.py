"""Who counts as a listener: a recorder that comes up before the node that works must not start a replay."""

from collections.abc import Iterator

import pytest
import rclpy
from rclpy.node import Node
from worlds.processes.waiting import comes_true

from semantic_slam.messages import topics
from semantic_slam.ros.bag_player import ONLOOKERS
from semantic_slam.ros.wire import qos
from semantic_slam.ros.wire.transport import Outlet, ros_type

pytestmark = pytest.mark.ros

TOPIC = topics.ODOMETRY


@pytest.fixture
def context() -> Iterator[rclpy.Context]:
    context = rclpy.Context()
    rclpy.init(context=context)
    yield context
    context.try_shutdown()


def listener(context: rclpy.Context, name: str) -> Node:
    node = Node(name, context=context)
    kind = ros_type(topics.TYPES[TOPIC])
    node.create_subscription(kind, TOPIC, lambda message: None, qos.replayed(TOPIC))
    return node


def test_a_recorder_alone_is_no_listener(context: rclpy.Context) -> None:
    player = Node("player", context=context)
    outlet = Outlet(player, TOPIC, topics.TYPES[TOPIC], qos.replayed(TOPIC))
    recorder = listener(context, ONLOOKERS[0])
    assert outlet.wait_for_readers(1, 20.0)
    assert not comes_true(lambda: outlet.has_listener_besides(ONLOOKERS), 0.5)
    worker = listener(context, "worker")
    assert comes_true(lambda: outlet.has_listener_besides(ONLOOKERS), 20.0)
    for node in (worker, recorder, player):
        node.destroy_node()
