"""A backend's sign of life, over DDS between processes."""

import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from worlds.processes.waiting import comes_true

from semantic_slam.configuration import from_dict
from semantic_slam.inference.building import initial_pose_of, make_run_configuration
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.protocol import Candidates
from semantic_slam.messages import topics
from semantic_slam.messages.codec import encode
from semantic_slam.ros.node.health import Level
from semantic_slam.ros.rounds.liveliness import LEASE_S, Watch
from semantic_slam.ros.rounds.ros_pool import RosPool
from semantic_slam.ros.wire import qos
from semantic_slam.ros.wire.transport import Outlet, relative_name

pytestmark = [pytest.mark.ros, pytest.mark.slow]

BACKEND = """
import rclpy
from rclpy.node import Node
from semantic_slam.ros.rounds.liveliness import Sign
rclpy.init()
node = Node("backend_7")
sign = Sign(node, 7)
print("there", flush=True)
rclpy.spin(node)
"""


@contextmanager
def alive() -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen([sys.executable, "-c", BACKEND], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None and process.stdout.readline() == "there\n"
    yield process
    process.kill()
    process.wait()


@pytest.fixture
def backend() -> Iterator[subprocess.Popen[str]]:
    with alive() as process:
        yield process


@pytest.fixture
def watcher() -> Iterator[tuple[Node, Watch]]:
    context = rclpy.Context()
    rclpy.init(context=context)
    node = Node("watcher", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    thread = threading.Thread(target=executor.spin, daemon=True)
    watch = Watch(node, (7,))
    thread.start()
    yield node, watch
    executor.shutdown()
    thread.join()
    node.destroy_node()
    context.try_shutdown()


@pytest.mark.long
def test_who_paused_returns_and_who_was_killed_does_not(
    watcher: tuple[Node, Watch], backend: subprocess.Popen[str]
) -> None:
    node, watch = watcher
    assert comes_true(lambda: node.count_publishers("backend_7/alive") == 1)
    time.sleep(2.0 * LEASE_S)
    assert comes_true(lambda: watch.missing_s(7) == 0.0)
    backend.send_signal(signal.SIGSTOP)
    assert comes_true(lambda: watch.missing_s(7) > 0.2)
    backend.send_signal(signal.SIGCONT)
    assert comes_true(lambda: watch.missing_s(7) == 0.0)
    backend.kill()
    assert comes_true(lambda: watch.missing_s(7) > 2.0 * LEASE_S)


@pytest.fixture
def manager() -> Iterator[Node]:
    rclpy.init()
    node = Node("manager")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    threading.Thread(target=executor.spin, daemon=True).start()
    yield node
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown()


CONFIGURATION = from_dict({"semantic_model": {"kind": "none"}, "association": "open"})


@pytest.mark.long
def test_the_last_backend_is_waited_for_as_long_as_it_is_alive(manager: Node, backend: subprocess.Popen[str]) -> None:
    """It may be replaying a long run; one that is gone, and late, is given up."""
    pool = RosPool(manager, (7,), timeout_s=0.5)
    assert comes_true(lambda: pool._watch.was_seen(7))
    pool.start(make_run_configuration(CONFIGURATION, None, *initial_pose_of(CONFIGURATION), stamp_ns=1))
    answers: list[list[object]] = []
    asking = threading.Thread(target=lambda: answers.append([*pool.expand(Keyframe.planar(0))]))
    asking.start()
    time.sleep(3.0)
    assert pool.backend_ids == (7,) and asking.is_alive()
    backend.kill()
    assert comes_true(lambda: pool.backend_ids == ())
    asking.join(120.0)
    assert answers == [[]]


def test_a_backend_that_was_given_up_before_the_manager_was_started_again_comes_back(manager: Node) -> None:
    """A journal restores only which backends are asked."""
    run = make_run_configuration(CONFIGURATION, None, *initial_pose_of(CONFIGURATION), stamp_ns=1)
    pool, backends = RosPool(manager, (0, 1), timeout_s=60.0), InProcessPool(2)
    pool.start(run)
    backends.start(run)
    pool.backend_ids = (1,)
    assert [status.level for status in pool.statuses() if status.name == "backend_0"] == [Level.ERROR]
    answers: list[list[Candidates]] = []
    keyframe = Keyframe.planar(0)
    asking = threading.Thread(target=lambda: answers.append(pool.expand(keyframe)))
    asking.start()
    outlet = Outlet(manager, relative_name(topics.CANDIDATES), topics.TYPES[topics.CANDIDATES], qos.everything())
    assert comes_true(lambda: outlet.num_readers == 1)
    for answer in backends.expand(keyframe):
        outlet.send(encode(answer))
    asking.join(120.0)
    assert [answer.backend_id for answer in answers[0]] == [1]
    assert pool.backend_ids == (0, 1)
    assert not [status for status in pool.statuses() if status.level is Level.ERROR]


def says(pool: RosPool, level: Level, text: str) -> bool:
    return any(status.level is level and text in status.message for status in pool.statuses())


@pytest.mark.long
def test_only_a_backend_that_is_not_there_is_to_be_started(manager: Node, backend: subprocess.Popen[str]) -> None:
    """One that was given up and is there again takes part by itself, and one that computes is waited for."""
    pool = RosPool(manager, (7, 8), timeout_s=60.0)
    assert comes_true(lambda: pool._watch.is_alive(7))
    pool.start(make_run_configuration(CONFIGURATION, None, *initial_pose_of(CONFIGURATION), stamp_ns=1))
    pool.backend_ids = (8,)
    assert says(pool, Level.WARN, "backend_7 was given up, and is there")
    pool.backend_ids = (7,)
    asking = threading.Thread(target=lambda: pool.expand(Keyframe.planar(0)))
    asking.start()
    assert comes_true(lambda: says(pool, Level.WARN, "backend_7 is busy: no candidates of keyframe 0 for 3 s"))
    pool.timeout_s = 0.0
    backend.kill()
    assert comes_true(lambda: pool.backend_ids == ())
    assert says(pool, Level.ERROR, "backend_7 was given up; its hypotheses moved to other backends; start it again")
    asking.join(120.0)


@pytest.mark.long
def test_two_backends_of_one_number_are_warned_of(manager: Node, backend: subprocess.Popen[str]) -> None:
    pool = RosPool(manager, (7,), timeout_s=60.0)
    assert comes_true(lambda: pool._watch.is_alive(7)) and not says(pool, Level.WARN, "more than once")
    with alive() as other:
        assert comes_true(lambda: says(pool, Level.WARN, "backend_7 runs more than once"))
        other.kill()
        assert comes_true(lambda: not says(pool, Level.WARN, "more than once"))
        assert pool._watch.is_alive(7)
