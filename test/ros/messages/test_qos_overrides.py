"""Parameters ``qos_overrides.*`` change the quality of service of what other packages publish or read."""

from collections.abc import Iterator

import pytest
import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy

from semantic_slam.errors import InputError
from semantic_slam.messages import topics
from semantic_slam.ros.wire import qos
from semantic_slam.ros.wire.transport import Outlet, receive

pytestmark = pytest.mark.ros


@pytest.fixture(autouse=True)
def context() -> Iterator[None]:
    rclpy.init()
    yield
    rclpy.shutdown()


def node_with(**overrides: object) -> Node:
    """A node with overrides of what it receives on ``odom``, and sends on ``~/pose``."""
    places = {"odom": "qos_overrides./odom.subscription", "pose": "qos_overrides./robot/pose.publisher"}
    named = {f"{places[name.partition('_')[0]]}.{name.partition('_')[2]}": value for name, value in overrides.items()}
    return rclpy.create_node("robot", parameter_overrides=[Parameter(name, value=own) for name, own in named.items()])


def profiles(node: Node, *, may_be_overridden: bool = True) -> tuple[QoSProfile, QoSProfile]:
    """Quality of service of the two, as others see it."""
    best_effort = qos.sensor_input(topics.ODOMETRY, lossless=False)
    receive(node, topics.ODOMETRY, lambda _: None, best_effort, may_be_overridden=may_be_overridden)
    Outlet(node, "~/pose", topics.TYPES[topics.POSE], qos.everything(), may_be_overridden=may_be_overridden)
    readers, writers = node.get_subscriptions_info_by_topic("/odom"), node.get_publishers_info_by_topic("/robot/pose")
    (reader,), (writer,) = ([end for end in ends if end.node_name == "robot"] for ends in (readers, writers))
    return reader.qos_profile, writer.qos_profile


def test_what_is_named_is_changed_and_nothing_else() -> None:
    node = node_with(odom_reliability="reliable", pose_reliability="best_effort")
    reader, writer = profiles(node)
    assert reader.reliability == ReliabilityPolicy.RELIABLE and writer.reliability == ReliabilityPolicy.BEST_EFFORT
    node.destroy_node()
    node = node_with()
    reader, writer = profiles(node)
    assert reader.reliability == ReliabilityPolicy.BEST_EFFORT and writer.reliability == ReliabilityPolicy.RELIABLE
    node.destroy_node()


def test_what_carries_the_rounds_cannot_be_changed() -> None:
    node = node_with(odom_reliability="reliable")
    reader, _ = profiles(node, may_be_overridden=False)
    assert reader.reliability == ReliabilityPolicy.BEST_EFFORT
    node.destroy_node()


@pytest.mark.parametrize(("name", "value"), [("odom_reliability", "sometimes"), ("odom_depth", "many")])
def test_a_wrong_override_is_one_line_that_names_it(name: str, value: object) -> None:
    node = node_with(**{name: value})
    with pytest.raises(InputError, match="parameters of robot: a qos_overrides is wrong"):
        profiles(node)
    node.destroy_node()
