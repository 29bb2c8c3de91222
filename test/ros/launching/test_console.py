"""What a person at the console sees of a node, and how nodes and their processes end."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from worlds.belief_factory import small_belief
from worlds.processes.interrupted import has_loaded, interrupted

from semantic_slam.bag.writer import BagWriter
from semantic_slam.errors import InputError
from semantic_slam.messages import topics
from semantic_slam.ros import demo
from semantic_slam.ros.launching import node_set
from semantic_slam.ros.launching.processes import NodeProcesses
from semantic_slam.ros.node.health import InputMonitor, Level, Status, console_text

STARTER = """
import sys, time
from pathlib import Path
from semantic_slam.ros.launching.node_set import NodeSpec
from semantic_slam.ros.launching.processes import NodeProcesses
import os
with NodeProcesses(Path(sys.argv[1]), os.environ) as nodes:
    for n in range(3):
        nodes.start(NodeSpec("sleeper", f"sleeper_{n}"), [sys.executable, "-c", "import time; time.sleep(600)"])
    print(*(process.pid for process in nodes._processes.values()), flush=True)
    time.sleep(600)
"""


def is_there(pid: int) -> bool:
    """Whether a process runs; one that nobody has asked about since it ended does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_nodes_end_with_whoever_started_them_when_that_is_killed(tmp_path: Path) -> None:
    starter = subprocess.Popen([sys.executable, "-c", STARTER, str(tmp_path)], stdout=subprocess.PIPE, text=True)
    assert starter.stdout is not None
    pids = [int(word) for word in starter.stdout.readline().split()]
    assert len(pids) == 3 and all(is_there(pid) for pid in pids)
    starter.kill()
    starter.wait()
    give_up = time.monotonic() + 120.0
    while any(is_there(pid) for pid in pids) and time.monotonic() < give_up:
        time.sleep(0.05)
    assert not any(is_there(pid) for pid in pids)


def test_the_console_says_what_is_waited_for_and_what_is_wrong_and_else_nothing() -> None:
    monitor = InputMonitor("/odom", 0.0)
    assert console_text([monitor.status(1.0, 1)]) == "waiting for /odom"
    assert "/odom is silent: no message so far" in console_text([monitor.status(9.0, 0)])
    monitor.arrived(9.5)
    well = [monitor.status(9.6, 1), Status("backend_0", Level.OK, "answering")]
    assert console_text(well) == ""
    both = [
        *well,
        Status("dropped", Level.WARN, "2 x odom: stamp repeats"),
        InputMonitor("/detections", 9.0).status(9.6, 1),
    ]
    assert console_text(both) == "2 x odom: stamp repeats; waiting for /detections"


@pytest.mark.parametrize(("rate", "most_s"), [(1.0, 3600.0 + 7200.0), (2.0, 3600.0 + 3600.0), (0.0, 3600.0 + 72000.0)])
def test_a_demo_of_a_long_recording_is_waited_for_as_long_as_that_is(
    rate: float, most_s: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        for stamp_s in (5, 7205):
            writer.write(topics.BELIEF, small_belief(0, [1], [1], [1.0], [4], [[4]]), stamp_s * 10**9)
    waited: dict[str, float] = {}
    monkeypatch.setattr(NodeProcesses, "wait", lambda _, name, timeout_s: waited.update({name: timeout_s}))
    monkeypatch.setattr(node_set, "node_set", lambda *_, **__: [])
    words = ["--bag", str(tmp_path / "bag"), "--rate", str(rate), "--out", str(tmp_path / "out")]
    demo.replay(demo.parse(words), tmp_path / "belief")
    assert waited == {name: pytest.approx(most_s) for name in ("bag_recorder", "bag_player")}


def test_a_demo_takes_the_domain_that_it_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "97")
    assert demo.domain() == 97
    monkeypatch.delenv("ROS_DOMAIN_ID")
    assert 1 <= demo.domain() <= demo.DOMAINS
    for wrong in ("-1", "many", "233"):
        monkeypatch.setenv("ROS_DOMAIN_ID", wrong)
        with pytest.raises(InputError, match="ROS_DOMAIN_ID is"):
            demo.domain()


NODE = "import sys; sys.argv[0] = '{0}'; from semantic_slam.cli.nodes import {0}; {0}()"
READY = ": ready"
INTERRUPTED = (
    ("backend_node", "rclpy"),
    ("backend_node", "gtsam"),
    ("classifier_node", "numpy"),
    ("classifier_node", "libtorch"),
    ("hypothesis_manager_node", "semantic_slam_msgs"),
    ("bag_recorder", READY),
    ("bag_player", READY),
    ("hypothesis_manager_node", READY),
)
"""Nodes, and the library that they load (messages: while they are made) or the word that they say by then."""
GIVEN = {
    "backend_node": ["-r", "__node:=backend_0"],
    "bag_player": ["-p", f"bag:={Path(__file__).parents[3] / 'bags' / 'aliased_room'}"],
}


@pytest.mark.long
@pytest.mark.ros
@pytest.mark.slow
@pytest.mark.parametrize(("name", "mark"), INTERRUPTED)
def test_a_node_that_is_interrupted_ends_well_and_without_a_word(name: str, mark: str, tmp_path: Path) -> None:
    given = GIVEN.get(name, ["-p", f"bag:={tmp_path / 'bag'}"] if name == "bag_recorder" else [])
    said = tmp_path / "said"
    ending = interrupted(
        [sys.executable, "-c", NODE.format(name), "--ros-args", *given],
        lambda pid: mark in said.read_text() if mark == READY else has_loaded(pid, mark),
        said,
        os.environ | {"_ROS_WHEELS_BOOTSTRAP_COMPLETE": "1"},
    )
    assert ending.code == 0 and "Traceback" not in ending.said
    assert ending.is_at_once, f"{ending.cpu_s:.1f} s of CPU"


IDLE = """
import os, signal, threading, rclpy
from rclpy.executors import SingleThreadedExecutor
from semantic_slam.ros.node.interrupt import Interrupt
rclpy.init()
executor = SingleThreadedExecutor()
interrupt = Interrupt(executor.wake)
executor.add_node(rclpy.create_node("idle"))
threading.Timer(1.0, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
executor.spin_until_future_complete(interrupt)
"""


@pytest.mark.ros
@pytest.mark.slow
def test_an_interrupt_wakes_a_node_that_has_nothing_to_do() -> None:
    assert subprocess.run([sys.executable, "-c", IDLE], timeout=60.0).returncode == 0


CALLBACKS = """
import gc, signal, rclpy
from rclpy.executors import SingleThreadedExecutor
from semantic_slam.ros.node.interrupt import Interrupt
rclpy.init()
executor = SingleThreadedExecutor()
interrupt, held = Interrupt(executor.wake), []
node = rclpy.create_node("busy")
executor.add_node(node)
def turn():
    if len(held) in (100, 500):
        gc.collect()
    held.append(len(gc.get_objects()))
    if len(held) > 501:
        signal.raise_signal(signal.SIGINT)
node.create_timer(1e-4, turn)
executor.spin_until_future_complete(interrupt)
print(held[500] - held[100])
"""


@pytest.mark.long
def test_a_node_holds_no_more_however_many_callbacks_it_has_run() -> None:
    """In rclpy an executor that spins until a future is done leaves a function with that future at every turn."""
    told = subprocess.run([sys.executable, "-c", CALLBACKS], capture_output=True, text=True, timeout=60.0, check=True)
    assert int(told.stdout) < 100, "objects after 400 callbacks"
