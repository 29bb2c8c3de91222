"""Runs that a few processes share: what they write, drop and say is what one process does."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
from worlds.bags.bag_factory import input_entries, of_topic, without, write_bag, write_configuration
from worlds.bags.places import place_entries
from worlds.processes.interrupted import children, has_loaded, interrupted

from semantic_slam.bag.reader import BagReader
from semantic_slam.configuration import Configuration, load_configuration
from semantic_slam.errors import InputError
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.protocol import Candidates
from semantic_slam.messages import topics
from semantic_slam.pipeline.offline import RunSummary, run_bag
from semantic_slam.pipeline.shared_run import run_shared

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
LONG_FRAMES = 500


def both(folder: Path, bag: Path, configuration: Configuration, most: int | None = None) -> tuple[RunSummary, ...]:
    """By one process and by three; all messages are compared byte for byte."""
    alone = run_bag(bag, folder / "alone", configuration, max_keyframes=most)
    shared = run_shared(bag, folder / "shared", configuration, max_keyframes=most, processes=3)
    assert _messages(folder / "shared") == _messages(folder / "alone")
    return alone, shared


def _messages(bag: Path) -> list[tuple[str, int, bytes]]:
    with BagReader(bag) as reader:
        return [(item.topic, item.stamp_ns, item.cdr) for item in reader.messages(reader.topics)]


def told(summary: RunSummary) -> tuple[object, ...]:
    return summary.num_frames, summary.num_keyframes, summary.dropped, str(summary.fault)


@pytest.mark.long
@pytest.mark.parametrize("most", [None, 2])
def test_all_that_is_written_and_dropped_is_the_same(tmp_path: Path, most: int | None) -> None:
    configuration = load_configuration(write_configuration(tmp_path / "configuration"))
    entries = input_entries(4) if most is None else place_entries("ranges")  # the latter need no network
    end = max(entry.stamp_ns for entry in entries)
    late = [replace(of_topic(entries, topic)[0], stamp_ns=end + 1) for topic in (topics.ODOMETRY, topics.DETECTIONS)]
    alone, shared = both(tmp_path, write_bag(tmp_path / "bag", [*entries, *late]), configuration, most)
    assert told(shared) == told(alone)
    assert shared.num_keyframes == (most or 4)
    assert bool(shared.dropped) == (most is None)


@pytest.mark.long
def test_a_damaged_bag_is_used_up_to_its_damage(tmp_path: Path) -> None:
    configuration = load_configuration(write_configuration(tmp_path / "configuration"))
    bag = write_bag(tmp_path / "bag", place_entries("ranges"))
    (file,) = bag.glob("*.mcap")
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    alone, shared = both(tmp_path, bag, configuration)
    assert told(shared) == told(alone)
    assert shared.fault is not None


@pytest.mark.long
def test_a_bag_without_a_keyframe_is_refused_in_the_same_words(tmp_path: Path) -> None:
    configuration = load_configuration(write_configuration(tmp_path / "configuration"))
    entries = place_entries("ranges")
    nowhere = of_topic(entries, topics.ODOMETRY)[0]
    nowhere.message.pose.pose.position.x = float("nan")
    bag = write_bag(tmp_path / "bag", [*without(entries, topics.ODOMETRY), nowhere])
    with pytest.raises(InputError) as here:
        run_bag(bag, tmp_path / "alone", configuration)
    with pytest.raises(InputError) as there:
        run_shared(bag, tmp_path / "shared", configuration, processes=2)
    assert str(there.value) == str(here.value)


class _FailingPool(InProcessPool):
    """It cannot go on after two keyframes, when all has been read."""

    def expand(self, keyframe: Keyframe) -> list[Candidates]:
        if keyframe.index == 2:
            while "Z" not in [_state(number) for number in children(os.getpid())]:
                time.sleep(0.02)
            raise InputError("this is where it ends")
        return super().expand(keyframe)


@pytest.mark.long
def test_what_ends_a_run_is_told_when_all_has_been_read_ahead(tmp_path: Path) -> None:
    configuration = load_configuration(write_configuration(tmp_path / "configuration"))
    bag = write_bag(tmp_path / "bag", place_entries("ranges"))
    summary = run_bag(bag, tmp_path / "belief", configuration, pool=_FailingPool(1), reads_ahead=True)
    assert str(summary.fault) == "this is where it ends"
    assert summary.num_keyframes == 2
    with BagReader(tmp_path / "belief") as reader:
        assert topics.DIAGNOSTICS.rsplit("/", 1)[-1] in {name.rsplit("/", 1)[-1] for name in reader.topics}


def test_hypotheses_that_would_replay_the_drive_are_not_shared(tmp_path: Path) -> None:
    configuration = Configuration.of(association="open", history={"horizon_keyframes": 50})
    with pytest.raises(InputError, match=r"--processes 4: with history.horizon_keyframes .*give 2 at most"):
        run_shared(tmp_path / "bag", tmp_path / "belief", configuration, processes=4)


@pytest.mark.long
@pytest.mark.parametrize("place", ["backend_process", "front_end_process"])
def test_a_process_that_is_lost_ends_the_run_with_a_remedy(long_drive: Path, tmp_path: Path, place: str) -> None:
    with _reported(long_drive, tmp_path / "out") as command:
        (number,) = [n for n, words in children(command.pid).items() if place in words]
        os.kill(number, signal.SIGKILL)
        _, words = command.communicate(timeout=120)
    assert command.returncode == 1
    assert "ended with exit code -9; free memory, or run all in one process: --processes 1" in words.splitlines()[-1]


@pytest.mark.long
def test_ctrl_c_ends_all_processes(long_drive: Path, tmp_path: Path) -> None:
    with _reported(long_drive, tmp_path / "out") as command:
        started = [number for number, words in children(command.pid).items() if "_process" in words]
        command.send_signal(signal.SIGINT)
        command.communicate(timeout=120)
    assert command.returncode == 130
    assert len(started) == 2
    for number in started:
        with pytest.raises(ProcessLookupError):
            os.kill(number, 0)


@pytest.mark.long
@pytest.mark.parametrize("processes", [1, 2])
def test_ctrl_c_while_pytorch_is_loaded_ends_a_report_at_once_and_nothing_stays(tmp_path: Path, processes: int) -> None:
    words = [sys.executable, "-m", "semantic_slam.cli.bag_to_report", str(ROOT / "bags/aliased_room")]
    words += ["--processes", str(processes), "--out", str(tmp_path / "out")]
    ending = interrupted(words, lambda pid: has_loaded(pid, "libtorch"), tmp_path / "said")
    assert ending.code == 130 and "Traceback" not in ending.said
    assert ending.is_at_once, f"{ending.cpu_s:.1f} s of CPU"
    assert not (tmp_path / "out").exists()


@pytest.fixture(scope="module")
def long_drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bag whose report takes far longer than a test looks on, and no network, which takes seconds to load."""
    return write_bag(tmp_path_factory.mktemp("long") / "bag", place_entries("ranges", LONG_FRAMES))


@contextmanager
def _reported(bag: Path, out: Path) -> Iterator[subprocess.Popen[str]]:
    """A report of a bag by three processes, once its first frame is done."""
    words = ["-m", "semantic_slam.cli.bag_to_report", str(bag), "--processes", "3"]
    command = subprocess.Popen(
        [sys.executable, *words, "--out", str(out)],
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # which those in the background ignore
    )
    try:
        assert command.stderr is not None
        said = ""
        while not re.search(rf" [1-9]\d*/{LONG_FRAMES} ", said):
            letter = command.stderr.read(1)
            assert letter, said
            said += letter
        yield command
    finally:
        command.kill()
        command.wait()


def _state(number: int) -> str:
    """One letter, as Linux tells it; Z: ended."""
    return Path(f"/proc/{number}/stat").read_text().rsplit(") ", 1)[1][0]
