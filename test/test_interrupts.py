"""Ctrl-C ends a run between two messages, not in the midst of one, and does not wait for a slow import."""

import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from threading import Thread

import pytest

from semantic_slam.configuration import load_configuration
from semantic_slam.interrupts import NotedInterrupt, import_interruptibly, noted_interrupts, raised_at_once
from semantic_slam.pipeline import front_end, offline

ROOT = Path(__file__).parents[1]


@pytest.fixture(autouse=True)
def pythons_own_handler() -> Iterator[None]:
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_the_first_one_is_raised_when_one_asks() -> None:
    with pytest.raises(KeyboardInterrupt), noted_interrupts() as check:
        check()
        signal.raise_signal(signal.SIGINT)
        done = "what was begun"
        check()
    assert done == "what was begun"
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_an_interrupt_that_was_not_checked_for_is_raised_at_the_end() -> None:
    with pytest.raises(KeyboardInterrupt), noted_interrupts():
        signal.raise_signal(signal.SIGINT)


def test_a_second_interrupt_is_raised_at_once() -> None:
    reached = []
    with pytest.raises(KeyboardInterrupt), noted_interrupts():
        signal.raise_signal(signal.SIGINT)
        reached.append(1)
        signal.raise_signal(signal.SIGINT)
        reached.append(2)
    assert reached == [1]


def test_a_handler_of_somebody_else_stays() -> None:
    heard: list[int] = []
    signal.signal(signal.SIGINT, lambda number, _: heard.append(number))
    with noted_interrupts() as check:
        signal.raise_signal(signal.SIGINT)
        check()
    assert heard == [signal.SIGINT]


def test_other_threads_cannot_and_do_not_take_it() -> None:
    entered = []

    def work() -> None:
        with noted_interrupts() as check:
            check()
            entered.append(signal.getsignal(signal.SIGINT))

    thread = Thread(target=work)
    thread.start()
    thread.join()
    assert entered == [signal.default_int_handler]


def test_an_interrupt_while_the_network_is_loaded_waits_until_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An exception within a constructor of C++ may abort the process."""
    build, reached = front_end.build_classifier, []

    def interrupted(configuration):
        signal.raise_signal(signal.SIGINT)
        reached.append("built")
        return build(configuration)

    monkeypatch.setattr(front_end, "build_classifier", interrupted)
    configuration = load_configuration(ROOT / "config" / "default.yaml")
    with pytest.raises(KeyboardInterrupt):
        offline.run_bag(ROOT / "bags" / "aliased_room", tmp_path / "belief", configuration)
    assert reached == ["built"]


SLOW = """
import os, signal, sys, time
from pathlib import Path
os.kill(os.getpid(), signal.SIGINT)
while not Path(__file__).with_name("released").exists():
    time.sleep(0.01)
"""


@pytest.fixture
def slow_module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """A module that interrupts this process when its import begins, which ends with the test."""
    name = f"slow_{tmp_path.name}"
    (tmp_path / f"{name}.py").write_text(SLOW)
    monkeypatch.syspath_prepend(tmp_path)
    yield name
    (tmp_path / "released").touch()


@pytest.mark.parametrize("is_noted", [False, True])
def test_an_interrupt_during_a_slow_import_is_raised_before_that_has_ended(slow_module: str, is_noted: bool) -> None:
    if is_noted:
        signal.signal(signal.SIGINT, noted := NotedInterrupt())
    with pytest.raises(KeyboardInterrupt):
        import_interruptibly(slow_module)
    assert not is_noted or signal.getsignal(signal.SIGINT) is noted


def test_an_interrupt_before_a_slow_import_is_raised_in_its_place(slow_module: str) -> None:
    with pytest.raises(KeyboardInterrupt), noted_interrupts():
        signal.raise_signal(signal.SIGINT)
        import_interruptibly(slow_module)
    assert slow_module not in sys.modules


def test_a_noted_one_is_raised_by_one_wait_alone() -> None:
    signal.signal(signal.SIGINT, noted := NotedInterrupt())
    signal.raise_signal(signal.SIGINT)
    reached = []
    with pytest.raises(KeyboardInterrupt), raised_at_once():
        reached.append(1)
    with raised_at_once():
        reached.append(2)
    assert noted.has_come and reached == [2]


def test_what_an_import_raises_is_raised() -> None:
    with pytest.raises(ModuleNotFoundError, match="no_such_module"):
        import_interruptibly("no_such_module")
