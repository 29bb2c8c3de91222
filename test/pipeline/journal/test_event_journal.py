"""What happened to a manager is in its journal before it counts, and happens again after a restart, in order."""

from collections.abc import Callable
from pathlib import Path

import pytest

from semantic_slam.errors import InputError
from semantic_slam.pipeline.journal.event_journal import END, PAUSE, EventJournal
from semantic_slam.pipeline.journal.journal import Journal
from semantic_slam.pipeline.journal.segment import Record

RUN, TOPIC, ANSWER = "this run", "odometry", "candidates"


class KilledError(Exception):
    """The process is gone."""


def end_process(_: bytes) -> None:
    raise KilledError


class Process:
    """A manager that writes down what it handles, and takes an answer of its backends with every message."""

    def __init__(self, folder: Path) -> None:
        self.journal = Journal(folder, RUN)
        self.handled: list[tuple[str, bytes]] = []
        self.events = EventJournal(self.journal, {name: self._handler(name) for name in (PAUSE, END)})
        self.events.listen(TOPIC, self._receive)

    def _handler(self, name: str) -> Callable[[bytes], None]:
        return lambda data: self.handled.append((name, data))

    def _receive(self, data: bytes) -> None:
        self.handled.append((TOPIC, data))
        if self.journal.next is None:
            self.journal.append(ANSWER, data)
        else:
            assert self.journal.take() == Record(ANSWER, data)

    def recover(self) -> None:
        for event in self.events.past():
            self.events.happen_again(event)


def test_events_happen_again_in_order_and_those_after_them_follow(tmp_path: Path) -> None:
    first = Process(tmp_path)
    first.events.happen(TOPIC, b"a")
    first.events.happen(PAUSE, b"1")
    first.events.happen(TOPIC, b"b")
    first.journal.close()
    second = Process(tmp_path)
    second.recover()
    assert second.handled == first.handled == [(TOPIC, b"a"), (PAUSE, b"1"), (TOPIC, b"b")]
    second.events.happen(END)
    second.journal.close()
    third = Process(tmp_path)
    third.recover()
    assert third.handled == second.handled == [*first.handled, (END, b"")]


def test_an_event_whose_handling_ended_the_process_happens_again(tmp_path: Path) -> None:
    first = Process(tmp_path)
    first.events.listen(TOPIC, end_process)
    with pytest.raises(KilledError):
        first.events.happen(TOPIC, b"a")
    first.events.record(ANSWER, b"a")
    first.journal.close()
    second = Process(tmp_path)
    second.recover()
    assert second.handled == [(TOPIC, b"a")]


def test_an_answer_where_none_is_due_is_no_event(tmp_path: Path) -> None:
    first = Process(tmp_path)
    first.events.record(ANSWER, b"a")
    first.journal.close()
    with pytest.raises(InputError, match="goes on with candidates where no answer is due; remove it"):
        Process(tmp_path).recover()
