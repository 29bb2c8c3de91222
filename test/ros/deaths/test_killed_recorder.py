"""A recorder that is killed leaves what it recorded up to the last second, and the report can be made of it."""

import json
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
from worlds.bags.bag_factory import write_bag, write_configuration
from worlds.bags.places import place_entries
from worlds.belief_factory import small_belief
from worlds.processes.node_runs import TIMEOUT_S, Replay, processes

from semantic_slam.bag.reader import BagReader
from semantic_slam.bag.writer import BagWriter
from semantic_slam.messages import topics

NUM_FRAMES = 150
"""So many that the recorder is still at work when it is killed, however late the listener prints."""
LEAST_PRINTED = 4
RATE = 2.0
LOST_S = 1.0
"""The most that a killed recorder may lose, without what its threads wait for a core."""
EXAMPLE = [sys.executable, str(Path(__file__).parents[3] / "examples" / "print_belief.py")]


def newest_printed(replay: Replay) -> int:
    """The last keyframe that a second listener has printed; -1 before the first."""
    lines = [line for line in replay.output_of("print_belief").splitlines() if ": object" in line]
    return int(lines[-1].split(":")[0]) if lines else -1


def waited_s(pid: int) -> float:
    """Seconds that the threads of a process were ready to run and had no core, all together."""
    waited_ns = 0
    for task in Path(f"/proc/{pid}/task").iterdir():
        with suppress(OSError):  # a thread that has ended
            waited_ns += int((task / "schedstat").read_text().split()[1])
    return waited_ns / 1e9


class Witness:
    """Notes which beliefs another listener has, and when by the time that the recorder could have used."""

    def __init__(self, replay: Replay, recorder: int) -> None:
        self._replay, self._recorder = replay, recorder
        self._seen: list[tuple[float, int]] = []

    def newest_that_is_due(self) -> int:
        """The newest keyframe that was printed before the last ``LOST_S``; -1 before the first."""
        printed = newest_printed(self._replay)
        now_s = time.monotonic() - waited_s(self._recorder)
        self._seen.append((now_s, printed))
        return max((printed for at_s, printed in self._seen if at_s <= now_s - LOST_S), default=-1)


@pytest.fixture(scope="module")
def killed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, int]:
    """The bag of a recorder that was killed in a replay, and the newest keyframe of a second before."""
    folder = tmp_path_factory.mktemp("killed")
    bag = write_bag(folder / "bag", place_entries("ranges", NUM_FRAMES))
    configuration = write_configuration(folder / "configuration")
    replay = Replay(
        bag,
        configuration,
        folder,
        backends=1,
        commands={"print_belief": EXAMPLE},
        parameters={"bag_player": {"rate": RATE}},
        companions=("print_belief",),
    )
    with processes(folder) as nodes:
        for spec in replay.specs():
            nodes.start(spec, replay.commands.get(spec.name, ()))
        give_up = time.monotonic() + TIMEOUT_S
        witness = Witness(replay, nodes.pids()["bag_recorder"])
        while (newest := witness.newest_that_is_due()) < LEAST_PRINTED:
            nodes.check()
            assert time.monotonic() < give_up
            time.sleep(0.02)
        nodes.kill("bag_recorder")
    return replay.belief_bag, newest


@pytest.mark.long
@pytest.mark.ros
@pytest.mark.slow
def test_a_killed_recorder_leaves_what_it_had_up_to_the_last_second(
    killed: tuple[Path, int], capfd: pytest.CaptureFixture[str]
) -> None:
    bag, newest = killed
    assert not (bag / "metadata.yaml").exists()
    with BagReader(bag) as reader:
        beliefs = list(reader.messages([topics.BELIEF]))
    assert len(beliefs) >= newest + 1
    line = capfd.readouterr().err.strip()
    assert line.startswith(f"{bag}: its recorder was killed") and "Ctrl-C" in line and "\n" not in line


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.ros
def test_a_report_is_made_of_the_bag_of_a_killed_recorder(killed: tuple[Path, int], tmp_path: Path) -> None:
    bag, newest = killed
    command = [sys.executable, "-m", "semantic_slam.cli.bag_to_report", str(bag), "--out", str(tmp_path / "out")]
    result = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert result.returncode == 0
    (line,) = result.stderr.splitlines()
    assert "its recorder was killed" in line
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert len(report["keyframes"]) >= newest + 1
    assert "its recorder was killed" in report["fault"]


def test_what_is_flushed_is_on_disk_and_the_bag_goes_on(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        for k in range(3):
            writer.write(topics.BELIEF, small_belief(k, [1], [1], [1.0], [4], [[4]]), 1 + k)
            writer.flush()
            with BagReader(tmp_path / "bag") as reader:
                assert reader.unfinished and len(list(reader.messages())) == k + 1
    with BagReader(tmp_path / "bag") as reader:
        assert not reader.unfinished and reader.num_messages == 3
