"""What becomes of a run when one of its nodes ends, as the demo and the launch file both have it."""

import sys
from pathlib import Path

import pytest
from worlds.processes.node_runs import processes

from semantic_slam.errors import SemanticSlamError
from semantic_slam.ros.launching.node_set import NodeSpec
from semantic_slam.ros.launching.supervisor import LONGEST_DELAY_S, MOST_RESTARTS, WINDOW_S, Supervisor

KILLED, FAULT, BAD_INPUT = -9, 1, 2
SPECS = [
    NodeSpec("manager", "manager", {"resume": False}, again={"resume": True}),
    NodeSpec("classifier", "classifier", followers=("player",)),
    NodeSpec("fragile", "fragile", again=None),
    NodeSpec("player", "player"),
]


def supervisor() -> Supervisor:
    return Supervisor(SPECS, last="player")


@pytest.mark.parametrize("exit_code", [KILLED, FAULT])
def test_a_node_that_died_is_started_again_and_told_that_it_goes_on(exit_code: int) -> None:
    verdict = supervisor().ended("manager", exit_code, 0.0)
    assert verdict.again is not None and verdict.again.parameters == {"resume": True}
    assert not verdict.ends_run and "started again" in verdict.text


def test_bad_input_ends_the_run_and_so_does_a_node_that_nothing_can_replace() -> None:
    assert supervisor().ended("manager", BAD_INPUT, 0.0).ends_run
    assert supervisor().ended("fragile", KILLED, 0.0).ends_run


def test_the_end_of_the_last_node_ends_the_run_that_of_others_does_not() -> None:
    assert not supervisor().ended("manager", 0, 0.0).ends_run
    assert supervisor().ended("player", 0, 0.0).ends_run


def test_a_node_that_dies_too_often_within_a_while_ends_the_run_and_waits_longer_each_time() -> None:
    watch = supervisor()
    verdicts = [watch.ended("manager", KILLED, float(n)) for n in range(MOST_RESTARTS + 1)]
    assert [verdict.ends_run for verdict in verdicts] == [False] * MOST_RESTARTS + [True]
    delays = [verdict.after_s for verdict in verdicts[:-1]]
    assert delays == sorted(delays) and delays[0] < delays[1] and delays[-1] == LONGEST_DELAY_S
    later = watch.ended("manager", KILLED, MOST_RESTARTS + WINDOW_S)
    assert not later.ends_run and later.after_s == delays[0]


def test_those_that_follow_a_node_are_killed_with_it_and_started_with_it() -> None:
    watch = supervisor()
    assert watch.ended("classifier", KILLED, 0.0).kill == ("player",)
    follower = watch.ended("player", KILLED, 0.1)
    assert follower.again is not None and follower.after_s == 0.0 and not follower.text
    assert watch.ended("player", KILLED, 0.2).text  # this time by itself


def test_a_node_that_is_done_follows_nobody() -> None:
    watch = supervisor()
    watch.ended("player", 0, 0.0)
    assert watch.ended("classifier", KILLED, 1.0).kill == ()


DIES_ONCE = """
import os, signal, sys, pathlib
mark = pathlib.Path(sys.argv[1])
if mark.exists():
    print("second life", flush=True)
else:
    mark.touch()
    print("first life", flush=True)
    os.kill(os.getpid(), signal.SIGKILL)
"""


def test_processes_are_started_again_and_their_log_goes_on(tmp_path: Path) -> None:
    spec = NodeSpec("none", "dier")
    with processes(tmp_path, Supervisor([spec])) as nodes:
        nodes.start(spec, [sys.executable, "-c", DIES_ONCE, str(tmp_path / "mark")])
        nodes.wait("dier", 60.0)
        assert nodes.tail("dier").split("\n") == ["  first life", "  second life"]


def test_without_a_supervisor_a_death_is_a_fault_with_the_last_lines(tmp_path: Path) -> None:
    with processes(tmp_path) as nodes:
        nodes.start(NodeSpec("none", "dier"), [sys.executable, "-c", DIES_ONCE, str(tmp_path / "mark")])
        with pytest.raises(SemanticSlamError, match=r"dier ended with exit code -9:\n  first life"):
            nodes.wait("dier", 60.0)


def test_bad_input_of_a_supervised_node_ends_the_run_at_once(tmp_path: Path) -> None:
    spec = NodeSpec("none", "wrong")
    with processes(tmp_path, Supervisor([spec])) as nodes:
        nodes.start(spec, [sys.executable, "-c", "print('what is wrong'); raise SystemExit(2)"])
        with pytest.raises(SemanticSlamError, match=r"wrong ended with exit code 2:\n  what is wrong"):
            nodes.wait("wrong", 60.0)


def test_a_follower_that_was_down_already_is_not_taken_for_killed_when_it_ends_later() -> None:
    watch = supervisor()
    assert watch.ended("player", FAULT, 0.0).again is not None
    assert watch.ended("classifier", KILLED, 0.1).kill == ("player",)
    watch.is_down("player")
    assert watch.ended("player", 0, 9.0).ends_run
