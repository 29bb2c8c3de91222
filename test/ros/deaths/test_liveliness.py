"""A backend's sign of life, over DDS between processes."""

import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from semantic_slam.ros.rounds.liveliness import LEASE_S, Watch

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


@pytest.fixture
def backend() -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen([sys.executable, "-c", BACKEND], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None and process.stdout.readline() == "there\n"
    yield process
    process.kill()
    process.wait()


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


def comes_true(condition: Callable[[], bool], timeout_s: float = 20.0) -> bool:
    give_up = time.monotonic() + timeout_s
    while not condition() and time.monotonic() < give_up:
        time.sleep(0.02)
    return condition()


def test_who_paused_returns_and_who_was_killed_does_not(
    watcher: tuple[Node, Watch], backend: subprocess.Popen[str]
) -> None:
    node, watch = watcher
    assert comes_true(lambda: node.count_publishers("backend_7/alive") == 1)
    time.sleep(2.0 * LEASE_S)
    assert watch.missing_s(7) == 0.0
    backend.send_signal(signal.SIGSTOP)
    assert comes_true(lambda: watch.missing_s(7) > 0.2)
    backend.send_signal(signal.SIGCONT)
    assert comes_true(lambda: watch.missing_s(7) == 0.0)
    backend.kill()
    assert comes_true(lambda: watch.missing_s(7) > 2.0 * LEASE_S)
