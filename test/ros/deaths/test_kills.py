"""Whatever node of a replay is killed, and when: it goes on, and ends with the beliefs of an undisturbed one.

``python -m semantic_slam_lab.kills`` does this at every tenth keyframe of the shipped bag, through the demo.
"""

import os
import re
import signal
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import pytest
from worlds.bags.bag_factory import input_entries, write_bag, write_configuration
from worlds.bags.places import entries_to_and_fro
from worlds.processes.node_runs import TIMEOUT_S, Replay, assert_same, beliefs, processes

from semantic_slam.bag.reader import BagReader
from semantic_slam.configuration import load_configuration
from semantic_slam.messages import topics
from semantic_slam.pipeline.offline import run_bag
from semantic_slam.ros.launching.node_set import NodeSpec, RunOptions, node_set
from semantic_slam.ros.launching.processes import NodeProcesses
from semantic_slam.ros.launching.supervisor import Supervisor

NUM_FRAMES = 20
SLOW_BACKEND = [sys.executable, str(Path(__file__).parents[1] / "faulty_backends.py"), "slow"]
EXAMPLE = [sys.executable, str(Path(__file__).parents[3] / "examples" / "print_belief.py")]
COMMANDS = {"backend_0": SLOW_BACKEND, "backend_1": SLOW_BACKEND, "print_belief": EXAMPLE}
KILLS = (
    (2, "backend_0"),
    (5, "classifier"),
    (8, "hypothesis_manager"),
    (11, "bag_recorder"),
    (14, "bag_player"),
)
ALL_AT = 16


def specs_of(bag: Path, configuration: Path, out: Path, *, resume: bool) -> list[NodeSpec]:
    options = RunOptions(backends=2, record=str(out / "belief"), journal=str(out / "journal"), resume=resume)
    specs = node_set(bag, configuration, 0.0, options, has_tf2=False, has_stereo=True)
    return [NodeSpec("print_belief", "print_belief"), *specs]


def start(nodes: NodeProcesses, specs: Sequence[NodeSpec]) -> None:
    for spec in specs:
        nodes.start(spec, COMMANDS.get(spec.name, ()))


def wait_for(nodes: NodeProcesses, printed: Path, keyframe: int) -> None:
    """Until a second listener has printed the keyframe; meanwhile those that died are started again."""
    give_up = time.monotonic() + TIMEOUT_S
    while not re.search(rf"^{keyframe}: object", printed.read_text(), re.MULTILINE):
        nodes.check()
        assert time.monotonic() < give_up, nodes.tail("hypothesis_manager")
        time.sleep(0.02)


def kill_all(nodes: NodeProcesses) -> None:
    for pid in nodes.pids().values():
        os.kill(pid, signal.SIGKILL)


def go_on(folder: Path, specs: Sequence[NodeSpec]) -> None:
    """Start all again, and wait for the end of the replay."""
    with processes(folder, Supervisor(specs)) as nodes:
        start(nodes, specs)
        nodes.wait("bag_recorder", TIMEOUT_S)
        nodes.wait("bag_player", TIMEOUT_S)


@pytest.mark.long
@pytest.mark.ros
@pytest.mark.slow
def test_a_replay_whose_nodes_are_killed_ends_with_the_same_beliefs(tmp_path: Path) -> None:
    """Each node once, one after the other, and at last all at once, after which the run is started again."""
    bag = write_bag(tmp_path / "bag", input_entries(NUM_FRAMES))
    configuration = write_configuration(tmp_path / "configuration", perception={"num_passes": 3})
    run_bag(bag, tmp_path / "offline", load_configuration(configuration))
    replay = Replay(bag, configuration, tmp_path, 2)
    printed = tmp_path / "log" / "print_belief.log"
    specs = specs_of(bag, configuration, tmp_path, resume=False)
    with processes(tmp_path, Supervisor(specs)) as nodes:
        start(nodes, specs)
        for keyframe, name in KILLS:
            wait_for(nodes, printed, keyframe)
            nodes.kill(name)
        wait_for(nodes, printed, ALL_AT)
        kill_all(nodes)
    go_on(tmp_path, specs_of(bag, configuration, tmp_path, resume=True))
    assert_same(beliefs(replay.belief_bag), beliefs(tmp_path / "offline"))
    with BagReader(replay.belief_bag) as live, BagReader(tmp_path / "offline") as offline:
        for topic in ("odom", topics.MEASUREMENTS, topics.BELIEF, topics.GROUND_TRUTH_ODOMETRY):
            name = "/" + topic.lstrip("/")
            assert live.counts[name] == offline.counts[name]


@pytest.mark.long
@pytest.mark.ros
@pytest.mark.slow
def test_the_only_backend_is_killed_and_replays_only_what_came_after_its_checkpoint(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    horizon, killed_at = 20, 26
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    changes = {"perception": {"num_passes": 3}, "weights": {"max_history": 10}}
    configuration = write_configuration(tmp_path / "own", **changes, history={"horizon_keyframes": horizon})
    bag = write_bag(tmp_path / "bag", input_entries(killed_at + 2))
    run_bag(bag, tmp_path / "offline", load_configuration(configuration))
    replay = Replay(bag, configuration, tmp_path, 1, companions=("print_belief",))
    specs = replay.specs()
    with processes(tmp_path, Supervisor(specs)) as nodes:
        start(nodes, specs)
        wait_for(nodes, tmp_path / "log" / "print_belief.log", killed_at)
        nodes.kill("backend_0")
        nodes.wait("bag_recorder", TIMEOUT_S)
        nodes.wait("bag_player", TIMEOUT_S)
    replayed = [int(count) for count in re.findall(r"(\d+) keyframes replayed", replay.output_of("backend_0"))]
    assert replayed and sum(replayed) < horizon
    assert_same(beliefs(replay.belief_bag), beliefs(tmp_path / "offline"))
    assert not list(tmp_path.glob("semantic_slam_*/*"))  # the last node of the run has removed the checkpoints


@pytest.mark.long
@pytest.mark.ros
@pytest.mark.slow
def test_a_manager_with_a_horizon_that_is_killed_goes_on_from_a_snapshot(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Killed alone, its backends living on, and with everything else, after which those ask for what they missed."""
    horizon, alone_at, all_at = 20, 45, 52
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    changes = {"perception": {"num_passes": 3}, "weights": {"max_history": 10}}
    configuration = write_configuration(tmp_path / "own", **changes, history={"horizon_keyframes": horizon})
    bag = write_bag(tmp_path / "bag", entries_to_and_fro(all_at + 3))
    run_bag(bag, tmp_path / "offline", load_configuration(configuration))
    replay = Replay(bag, configuration, tmp_path, 2)
    printed = tmp_path / "log" / "print_belief.log"
    specs = specs_of(bag, configuration, tmp_path, resume=False)
    with processes(tmp_path, Supervisor(specs)) as nodes:
        start(nodes, specs)
        wait_for(nodes, printed, alone_at)
        nodes.kill("hypothesis_manager")
        wait_for(nodes, printed, all_at)
        kill_all(nodes)
    told = replay.output_of("hypothesis_manager")
    go_on(tmp_path, specs_of(bag, configuration, tmp_path, resume=True))
    told += replay.output_of("hypothesis_manager")
    counts = [int(count) for count in re.findall(r"(\d+) of them from a snapshot", told)]
    assert len(counts) >= 2 and all(horizon <= count < alone_at for count in counts)
    assert_same(beliefs(replay.belief_bag), beliefs(tmp_path / "offline"))
