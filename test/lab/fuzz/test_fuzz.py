"""The fuzz harness finds what it is for, repeats a case from its seed, and finds nothing in what is here."""

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest
from semantic_slam_lab.fuzz import harness, limits
from semantic_slam_lab.fuzz.harness import Case, outcome, run
from semantic_slam_lab.fuzz.limits import MEMORY_BYTES
from semantic_slam_lab.fuzz.mutation import damaged, with_strange_values
from semantic_slam_lab.fuzz.targets import TARGETS

from semantic_slam.errors import InputError

DRAWS = 25
FEWER_DRAWS = {"crowds": 2, "drives": 11}
"""Of targets whose single case may take seconds; ``make fuzz``, which CI runs, begins with the same cases."""


def test_an_error_of_ours_is_well_and_another_is_a_finding_with_its_place() -> None:
    def refuses(chance: np.random.Generator) -> None:
        raise InputError("file: fault; remedy")

    def stumbles(chance: np.random.Generator) -> None:
        np.linalg.inv(np.zeros((2, 2)))

    def rambles(chance: np.random.Generator) -> None:
        raise InputError("x" * 5000)

    assert outcome("a", refuses, 0, 0) is None
    found = outcome("a", stumbles, 0, 7)
    assert found is not None and found.index == 7 and found.what.startswith("LinAlgError")
    assert outcome("a", rambles, 0, 0) is not None


def test_what_is_too_slow_or_too_large_is_a_finding_though_readers_catch_every_exception(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def spins(chance: np.random.Generator) -> None:
        try:
            while True:
                time.process_time()
        except Exception:
            return

    def swells(chance: np.random.Generator) -> None:
        np.ones(MEMORY_BYTES // 8 + (20 << 17))

    large = outcome("a", swells, 0, 0)
    monkeypatch.setattr(limits, "CPU_S", 0.5)
    slow = outcome("a", spins, 0, 0)
    assert slow is not None and "s of CPU" in slow.what
    assert large is not None and "MiB more" in large.what


def test_what_is_refused_may_cost_no_more_than_what_is_accepted() -> None:
    def refuses_late(chance: np.random.Generator) -> None:
        np.ones(MEMORY_BYTES // 8 + (20 << 17))
        raise InputError("file: fault; remedy")

    found = outcome("a", refuses_late, 0, 0)
    assert found is not None and found.what.startswith("TooLargeError") and "file: fault; remedy" in found.trace


def test_a_case_is_its_seed() -> None:
    drawn: list[bytes] = []

    def case(chance: np.random.Generator) -> None:
        drawn.append(damaged(bytes(range(200)), chance))

    for seed, index in ((0, 1), (0, 1), (0, 2), (1, 1)):
        outcome("a", case, seed, index)
    assert drawn[0] == drawn[1] and len(set(drawn)) == 3


def test_strange_values_leave_the_original_alone() -> None:
    document = {"a": [1, {"b": 2.0}], "c": "text"}
    chance = np.random.default_rng(0)
    assert any(with_strange_values(document, chance) != document for _ in range(9))
    assert document == {"a": [1, {"b": 2.0}], "c": "text"}


@pytest.fixture
def left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where temporary folders are made, by this process and its workers."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def test_a_worker_that_dies_is_a_finding_and_the_rest_goes_on(capfd: pytest.CaptureFixture[str], left: Path) -> None:
    def dying(folder: Path) -> Case:
        def case(chance: np.random.Generator) -> None:
            if chance.random() < 0.02:
                os._exit(9)

        return case

    arguments = argparse.Namespace(out=None, seconds=4.0, seed=0, jobs=1, target=None, index=None)
    assert run({"dying": dying}, arguments) == 1
    lines = capfd.readouterr().out.splitlines()
    cases, findings = (int(word) for word in lines[-1].replace(",", "").split() if word.isdigit())
    assert "the process died" in lines[0] and findings == 1 and cases > 60
    assert list(left.iterdir()) == []


def test_a_worker_that_hangs_is_killed_and_the_next_has_a_folder_of_its_own_of_which_nothing_stays(
    capfd: pytest.CaptureFixture[str], left: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def hanging(folder: Path) -> Case:
        (folder / "once").touch(exist_ok=False)
        return lambda chance: time.sleep(60.0)

    monkeypatch.setattr(harness, "HANG_S", 0.3)
    arguments = argparse.Namespace(out=None, seconds=2.0, seed=0, jobs=2, target=None, index=None)
    assert run({"hanging": hanging}, arguments) == 1
    *findings, last = capfd.readouterr().out.splitlines()
    assert len(findings) == 1 and "nothing for" in findings[0] and int(last.split()[0]) > 2
    assert list(left.iterdir()) == []


def test_a_case_that_hangs_when_the_time_is_over_is_waited_for_and_a_finding(
    capfd: pytest.CaptureFixture[str], left: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def blocking(folder: Path) -> Case:
        begun: list[int] = []

        def case(chance: np.random.Generator) -> None:
            begun.append(0)
            if len(begun) == 4:
                time.sleep(60.0)

        return case

    monkeypatch.setattr(harness, "HANG_S", 3.0)
    arguments = argparse.Namespace(out=None, seconds=1.0, seed=0, jobs=1, target=None, index=None)
    assert run({"blocking": blocking}, arguments) == 1
    finding, last = capfd.readouterr().out.splitlines()
    assert finding.startswith("blocking --index 3 ") and "nothing for 3 s" in finding
    assert last == "4 cases, 1 findings"
    assert list(left.iterdir()) == []


@pytest.mark.parametrize(("state", "used_s", "is_stuck"), [("S", 0.0, True), ("R", 0.2, False), ("R", 9.0, True)])
def test_a_worker_that_waits_for_its_turn_is_not_stuck(
    left: Path, monkeypatch: pytest.MonkeyPatch, state: str, used_s: float, is_stuck: bool
) -> None:
    worker = harness.Worker({"slow": lambda folder: lambda chance: time.sleep(60.0)}, 0, 0, 1, left)
    monkeypatch.setattr(harness, "HANG_S", 1.0)
    monkeypatch.setattr(harness, "process_state", lambda pid: (state, used_s))
    time.sleep(1.1)
    assert bool(list(worker.poll(0.0))) == is_stuck
    worker.stop()


def test_the_state_of_a_process_is_the_kernels() -> None:
    before = harness.process_state(os.getpid())
    sum(number * number for number in range(10**6))
    state, used_s = harness.process_state(os.getpid())
    assert state == "R" and used_s > before[1] > 0.0
    assert harness.process_state(None) == ("", 0.0)


def test_a_case_that_ends_well_after_the_time_is_counted(capfd: pytest.CaptureFixture[str], left: Path) -> None:
    arguments = argparse.Namespace(out=None, seconds=0.5, seed=0, jobs=2, target=None, index=None)
    assert run({"slow": lambda folder: lambda chance: time.sleep(1.5)}, arguments) == 0
    assert capfd.readouterr().out.splitlines() == ["2 cases, 0 findings"]


@pytest.mark.long
@pytest.mark.parametrize("name", TARGETS)
def test_the_first_cases_of_every_target_find_nothing(name: str, tmp_path: Path) -> None:
    case = TARGETS[name](tmp_path)
    found = [outcome(name, case, 0, index) for index in range(FEWER_DRAWS.get(name, DRAWS))]
    assert [finding for finding in found if finding is not None] == []


@pytest.mark.slow
def test_the_command_says_how_many_cases_it_tried_and_what_it_found() -> None:
    words = [sys.executable, "-m", "semantic_slam_lab.fuzz", "--seconds", "1", "--seed", "3", "--jobs", "1"]
    result = subprocess.run(words, capture_output=True, text=True, timeout=120)
    cases, word, findings, _ = result.stdout.splitlines()[-1].replace(",", "").split()
    assert (word, findings, result.returncode) == ("cases", "0", 0) and int(cases) > 0
