"""A journal that is begun anew with snapshots loses nothing, whenever it is killed, and says what is damaged."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from semantic_slam.errors import InputError
from semantic_slam.pipeline.journal import journal as journal_module
from semantic_slam.pipeline.journal import segment as segment_module
from semantic_slam.pipeline.journal.journal import FILE, NEW_FILE, NEXT_FILE, SNAPSHOT, Journal
from semantic_slam.pipeline.journal.segment import Segment

RUN, EVENT = "this run", "event"
APART = 4
"""Events from one snapshot to the next."""


class KilledError(Exception):
    """The process is gone."""


class Counting:
    """A process whose state is the numbers that it was told, one in each event."""

    def __init__(self, folder: Path) -> None:
        self.journal = Journal(folder, RUN)
        self.numbers = list(self.journal.snapshot)
        self.num_replayed = 0
        while self.journal.next is not None:
            record = self.journal.take()
            self.num_replayed += record.name == EVENT
            self.numbers += record.data

    def go_on(self, end: int) -> "Counting":
        for number in range(len(self.numbers), end):
            self.journal.append(EVENT, bytes([number]))
            self.numbers.append(number)
            if len(self.numbers) % APART == 0:
                self.journal.begin_anew(bytes(self.numbers))
        return self


def ended(folder: Path, end: int) -> Path:
    """The folder of a process that was killed after so many events."""
    Counting(folder).go_on(end).journal.close()
    return folder


def damage(path: Path, place: int) -> None:
    data = bytearray(path.read_bytes())
    data[place] ^= 1
    path.write_bytes(data)


@pytest.mark.parametrize("end", range(1, 4 * APART))
def test_a_process_goes_on_from_the_snapshot_before_the_newest(end: int, tmp_path: Path) -> None:
    again = Counting(ended(tmp_path, end))
    assert again.numbers == list(range(end))
    since = APART + end % APART if end >= 2 * APART else end
    assert again.num_replayed == since
    again.go_on(4 * APART)
    assert again.numbers == list(range(4 * APART))


def test_the_files_do_not_grow_with_the_drive(tmp_path: Path) -> None:
    sizes = []
    for end in (8 * APART, 16 * APART):
        ended(tmp_path, end)
        sizes.append(sum(path.stat().st_size for path in tmp_path.iterdir()))
    in_snapshots = 2 * 8 * APART  # of this process, whose state grows by one byte in each event
    assert sizes[1] == sizes[0] + in_snapshots


STEPS: tuple[tuple[object, str], ...] = (
    (segment_module.os, "open"),
    (segment_module.os, "write"),
    (segment_module.os, "fdatasync"),
    (segment_module.os, "replace"),
    (segment_module.os, "ftruncate"),
    (journal_module, "sync_folder"),
)


def killing(monkeypatch: pytest.MonkeyPatch, at: int, *, after: bool) -> list[str]:
    """Kill the process at its call number ``at`` of what changes files, before it or after; the calls that it makes."""
    calls: list[str] = []

    def wrapped(name: str, call: Callable[..., object]) -> Callable[..., object]:
        def wrapper(*arguments: object) -> object:
            is_last = len(calls) == at
            calls.append(name)
            if is_last and not after:
                if name == "write":  # a part of it
                    call(arguments[0], bytes(arguments[1])[: len(bytes(arguments[1])) // 2])  # type: ignore[call-overload]
                raise KilledError
            answer = call(*arguments)
            if is_last:
                raise KilledError
            return answer

        return wrapper

    for where, name in STEPS:
        monkeypatch.setattr(where, name, wrapped(name, getattr(where, name)))
    return calls


@pytest.mark.parametrize("after", [False, True])
@pytest.mark.parametrize("snapshots", [1, 2, 3])
def test_a_kill_at_any_step_of_a_snapshot_loses_nothing(snapshots: int, after: bool, tmp_path: Path) -> None:
    """Also in the middle of a write; the number of the event that was under way tells whether it was recorded."""
    end = snapshots * APART
    before = ended(tmp_path / "before", end - 1)
    num_killed = 0
    for at in range(100):
        folder = shutil.copytree(before, tmp_path / f"{at}")
        process = Counting(folder)
        with pytest.MonkeyPatch.context() as patch:
            calls = killing(patch, at, after=after)
            try:
                process.go_on(end)
            except KilledError:
                num_killed += 1
        process.journal.close()
        again = Counting(folder)
        assert again.numbers in (list(range(end - 1)), list(range(end)))
        assert len(again.numbers) == end or (at == 0 and not after)  # the first call records the event
        assert again.go_on(end + 2 * APART + 1).numbers == list(range(end + 2 * APART + 1))
        again.journal.close()
        assert Counting(folder).numbers == again.numbers
        if len(calls) <= at:
            break
    assert num_killed == at >= 7 and not (folder / NEW_FILE).exists()


def test_where_the_older_file_is_damaged_anywhere_the_newer_one_is_enough(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    whole = ended(tmp_path / "whole", 3 * APART + 1)
    for place in range(0, (whole / FILE).stat().st_size, 7):
        folder = shutil.copytree(whole, tmp_path / f"{place}")
        damage(folder / FILE, place)
        again = Counting(folder)
        assert again.numbers == list(range(3 * APART + 1)) and again.num_replayed == 1
        (line,) = capfd.readouterr().err.splitlines()
        assert line.endswith("journal: is damaged; the run goes on from journal.next alone")
        again.go_on(5 * APART).journal.close()
        assert Counting(folder).numbers == list(range(5 * APART))


def test_an_older_file_that_does_not_lead_to_the_newer_one_is_not_replayed(tmp_path: Path) -> None:
    ended(tmp_path, 2 * APART)
    earlier = (tmp_path / FILE).read_bytes()
    ended(tmp_path, 3 * APART)
    (tmp_path / FILE).write_bytes(earlier)
    again = Counting(tmp_path)
    assert again.numbers == list(range(3 * APART)) and again.num_replayed == 0


@pytest.mark.parametrize("name", [FILE, NEXT_FILE])
def test_a_damaged_snapshot_that_is_needed_is_one_line_with_the_remedy(name: str, tmp_path: Path) -> None:
    """Of the newest file, or of the only one; without the newest file the run goes on from where that began."""
    ended(tmp_path, 3 * APART + 2)
    if name == FILE:
        (tmp_path / NEXT_FILE).replace(tmp_path / FILE)
    damage(tmp_path / name, Segment.size_of("run", RUN.encode()) + 30)
    with pytest.raises(InputError, match=rf"{name}: its beginning is damaged; remove it, and what came since is lost"):
        Journal(tmp_path, RUN)
    (tmp_path / name).unlink()
    assert Counting(tmp_path).numbers == (list(range(3 * APART)) if name == NEXT_FILE else [])


def test_a_torn_end_of_the_newest_file_is_cut_off(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    ended(tmp_path, 2 * APART + 2)
    path = tmp_path / NEXT_FILE
    path.write_bytes(path.read_bytes()[:-3])
    again = Counting(tmp_path)
    assert again.numbers == list(range(2 * APART + 1))
    assert "journal.next: its last 23 bytes are torn; they are cut off" in capfd.readouterr().err
    assert again.go_on(4 * APART).numbers == list(range(4 * APART))


def test_a_snapshot_is_told_where_it_was_taken_and_not_taken_before_all_is_replayed(tmp_path: Path) -> None:
    ended(tmp_path, 2 * APART + 1)
    journal = Journal(tmp_path, RUN)
    with pytest.raises(ValueError, match="before all records were taken"):
        journal.begin_anew(b"")
    names = []
    while journal.next is not None:
        names.append(journal.take().name)
    assert names == [EVENT] * APART + [SNAPSHOT, EVENT]


def test_another_process_is_refused_after_the_files_were_exchanged(tmp_path: Path) -> None:
    process = Counting(tmp_path).go_on(3 * APART)
    with pytest.raises(InputError, match="another process goes on from it"):
        Journal(tmp_path, RUN)
    process.journal.close()
    anew = Journal(tmp_path, "another run", resume=False)
    assert anew.next is None and not anew.snapshot
    assert {path.name for path in tmp_path.glob("*.old")} == {"journal.old", "journal.next.old"}
