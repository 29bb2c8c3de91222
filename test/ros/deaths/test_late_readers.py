"""A manager that goes on after a restart is heard from its last keyframe on, also by readers that DDS matches late."""

from collections.abc import Callable, Iterator
from typing import Any

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from worlds.belief_factory import small_belief

from semantic_slam.inference.belief import HybridBelief
from semantic_slam.messages import topics
from semantic_slam.messages.codec import decode
from semantic_slam.ros.publishing.retold_beliefs import RetoldBeliefs
from semantic_slam.ros.wire import qos
from semantic_slam.ros.wire.transport import Outlet, receive

pytestmark = [pytest.mark.ros, pytest.mark.slow]

BELIEF = topics.BELIEF
MOST_TICKS = 2000


@pytest.fixture
def executor() -> Iterator[SingleThreadedExecutor]:
    rclpy.init()
    executor = SingleThreadedExecutor()
    yield executor
    executor.shutdown()
    rclpy.try_shutdown()


@pytest.fixture
def node(executor: SingleThreadedExecutor) -> Iterator[Node]:
    node = rclpy.create_node("manager")
    executor.add_node(node)
    yield node
    node.destroy_node()


@pytest.fixture
def outlet(node: Node) -> Outlet:
    return Outlet(node, BELIEF, topics.TYPES[BELIEF], qos.result(lossless=False))


@pytest.fixture
def beliefs(node: Node, outlet: Outlet) -> RetoldBeliefs:
    return RetoldBeliefs(node, outlet, "map")


def belief(keyframe: int) -> HybridBelief:
    return small_belief(keyframe, [1], [1], [1.0], [4], [[4]])


def heard_by_another(node: Node) -> list[int]:
    """Keyframe indices that another reader hears from now on."""
    heard: list[int] = []
    receive(
        node, BELIEF, lambda data: heard.append(decode(data, topics.TYPES[BELIEF]).keyframe), qos.result(lossless=False)
    )
    return heard


def at_once(function: Callable[[Any], None], item: Any) -> None:
    """What queues for the worker in a node does it here."""
    function(item)


def spin(executor: SingleThreadedExecutor, holds: Callable[[], bool]) -> bool:
    """Spin until a condition holds; whether it did."""
    for _ in range(MOST_TICKS):
        if holds():
            return True
        executor.spin_once(timeout_sec=0.05)
    return False


def test_whoever_is_matched_late_hears_all_since_the_restart_in_order(
    executor: SingleThreadedExecutor, node: Node, beliefs: RetoldBeliefs
) -> None:
    beliefs.send(belief(6))
    beliefs.go_on(belief(7), at_once)
    beliefs.send(belief(8))
    first = heard_by_another(node)
    assert spin(executor, lambda: first == [7, 8])
    beliefs.send(belief(9))
    assert spin(executor, lambda: first == [7, 8, 9])
    second = heard_by_another(node)
    assert spin(executor, lambda: second == [7, 8, 9] and first == [7, 8, 9, 7, 8, 9])


def test_a_new_belief_does_not_overtake_those_that_are_told_again(
    executor: SingleThreadedExecutor, node: Node, outlet: Outlet, beliefs: RetoldBeliefs
) -> None:
    beliefs.go_on(belief(7), at_once)
    heard = heard_by_another(node)
    assert outlet.wait_for_readers(1, 60.0)
    beliefs.send(belief(8))
    assert spin(executor, lambda: heard == [7, 8])


def test_a_reader_that_takes_the_place_of_another_is_told_again_without_another_belief(
    executor: SingleThreadedExecutor, node: Node, outlet: Outlet, beliefs: RetoldBeliefs
) -> None:
    """As a recorder that is started again while the robot stands."""
    first = rclpy.create_node("first")
    heard_by_another(first)
    assert outlet.wait_for_readers(1, 60.0)
    beliefs.go_on(None, at_once)
    beliefs.send(belief(7))
    first.destroy_node()
    assert spin(executor, lambda: outlet.num_readers == 0)
    for _ in range(20):  # looks that find nobody
        executor.spin_once(timeout_sec=0.05)
    heard = heard_by_another(node)
    assert spin(executor, lambda: heard == [7])


def test_nothing_is_told_again_of_a_run_that_has_ended(
    executor: SingleThreadedExecutor, node: Node, beliefs: RetoldBeliefs
) -> None:
    beliefs.go_on(belief(7), at_once)
    beliefs.forget()
    heard = heard_by_another(node)
    beliefs.send(belief(0))
    assert spin(executor, lambda: heard[-1:] == [0]) and set(heard) == {0}


def test_a_manager_that_was_not_restarted_tells_nothing_again(
    executor: SingleThreadedExecutor, node: Node, outlet: Outlet, beliefs: RetoldBeliefs
) -> None:
    beliefs.send(belief(0))
    heard = heard_by_another(node)
    assert outlet.wait_for_readers(1, 60.0)
    beliefs.send(belief(1))
    assert spin(executor, lambda: heard == [1])
