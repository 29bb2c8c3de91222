"""What a user of a full ROS 2 installation types: ros2 pkg, interface, launch, bag and topic find this package."""

import signal
import subprocess
from pathlib import Path

import pytest
from worlds.bags.bag_factory import input_entries, write_bag, write_configuration
from worlds.processes.node_runs import TIMEOUT_S, Replay, assert_same, beliefs, run

from semantic_slam.configuration import load_configuration
from semantic_slam.messages import topics
from semantic_slam.pipeline.offline import run_bag
from semantic_slam.ros.launching.node_set import RunOptions, node_set

pytestmark = [pytest.mark.ros_full, pytest.mark.ros, pytest.mark.slow]

NUM_FRAMES = 6
GRACE_S = 30.0
"""To end well after an interrupt."""


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    return write_bag(tmp_path / "input", input_entries(NUM_FRAMES))


@pytest.fixture
def configuration(tmp_path: Path) -> Path:
    return write_configuration(tmp_path / "configuration", perception={"num_passes": 3})


def ros2(*words: str) -> str:
    """What ``ros2 WORDS`` prints; fails with everything that it said unless it ends well, and in time."""
    with subprocess.Popen(["ros2", *words], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        try:
            said, _ = process.communicate(timeout=TIMEOUT_S)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGINT)  # ros2 launch ends its nodes then, which a kill would orphan
            said, _ = process.communicate(timeout=GRACE_S)
            raise AssertionError(f"ros2 {words[0]} has not ended after {TIMEOUT_S:.0f} s:\n{said}") from None
    assert process.returncode == 0, said
    return said


def test_executables_and_messages_are_found(bag: Path, configuration: Path) -> None:
    needed = {
        spec.executable
        for spec in node_set(bag, configuration, 0.0, RunOptions(record="out"), has_tf2=True, has_stereo=True)
    }
    assert needed <= set(ros2("pkg", "executables", "semantic_slam").replace("semantic_slam ", "").splitlines())
    assert "float64[] log_weights" in ros2("interface", "show", topics.TYPES[topics.BELIEF])


def test_the_launch_file_of_a_robot_names_its_arguments() -> None:
    told = ros2("launch", "semantic_slam", "robot.launch.py", "--show-args")
    assert all(f"'{name}'" in told for name in ("config", "journal", "record", "remap"))


def test_launch_ends_by_itself_and_its_beliefs_are_those_of_the_offline_pipeline(
    bag: Path, configuration: Path, tmp_path: Path
) -> None:
    record = tmp_path / "live"
    ros2("launch", "semantic_slam", "demo.launch.py", f"bag:={bag}", f"config:={configuration}", f"record:={record}")
    run_bag(bag, tmp_path / "offline", load_configuration(configuration))
    found = beliefs(record)
    assert len(found) == NUM_FRAMES
    assert_same(found, beliefs(tmp_path / "offline"))


def test_bag_info_reads_what_the_offline_pipeline_writes(bag: Path, configuration: Path, tmp_path: Path) -> None:
    run_bag(bag, tmp_path / "offline", load_configuration(configuration))
    lines = ros2("bag", "info", str(tmp_path / "offline")).splitlines()
    (belief,) = (line for line in lines if f"Topic: {topics.BELIEF} " in line)
    assert f"Type: {topics.TYPES[topics.BELIEF]}" in belief and f"Count: {NUM_FRAMES} " in belief


def test_topic_echo_prints_a_belief_of_the_running_nodes(bag: Path, configuration: Path, tmp_path: Path) -> None:
    """As a reader that may come late: what a lossless run has published is still sent to it."""
    quality = ["--qos-reliability", "reliable", "--qos-durability", "transient_local"]
    words = ["ros2", "topic", "echo", "--once", "--field", "keyframe", *quality, topics.BELIEF]
    with subprocess.Popen([*words, topics.TYPES[topics.BELIEF]], stdout=subprocess.PIPE, text=True) as echo:
        try:
            run(Replay(bag, configuration, tmp_path / "nodes", backends=1))
            said, _ = echo.communicate(timeout=GRACE_S)
        finally:
            echo.kill()
    assert int(said.split()[0]) in range(NUM_FRAMES)
