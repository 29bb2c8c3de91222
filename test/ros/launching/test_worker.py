"""The thread that processes a node's messages."""

import threading

import pytest

from semantic_slam.ros.node import worker
from semantic_slam.ros.node.worker import Worker


def test_a_call_that_waits_for_others_is_told_that_the_node_ends() -> None:
    waiting, waits, ended = Worker(lambda _: None), threading.Event(), threading.Event()

    def wait(_: None) -> None:
        waits.set()
        while not waiting.is_ending:
            threading.Event().wait(0.01)
        ended.set()

    waiting.submit(wait, None)
    waiting.start()
    assert waits.wait(60.0) and not waiting.is_ending
    waiting.stop()
    assert ended.wait(60.0)


def test_after_it_was_stopped_no_call_begins_and_those_that_are_left_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(worker, "PATIENCE_S", 0.05)
    monkeypatch.setattr(worker, "LAST_CALL_S", 60.0)
    slow, done = Worker(lambda _: None), []

    def call(number: int) -> None:
        threading.Event().wait(0.02)
        done.append(number)

    for number in range(200):
        slow.submit(call, number)
    slow.start()
    assert slow.is_working
    slow.stop()
    assert not slow.is_working and 0 < len(done) < 200
    assert done + slow.left() == list(range(200))
    assert slow.left() == []
