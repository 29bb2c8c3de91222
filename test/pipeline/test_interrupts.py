"""Ctrl-C ends a run between two messages, not in the midst of one."""

import signal
from collections.abc import Iterator
from pathlib import Path
from threading import Thread

import pytest

from semantic_slam.configuration import load_configuration
from semantic_slam.pipeline import front_end, offline
from semantic_slam.pipeline.interrupts import noted_interrupts

ROOT = Path(__file__).parents[2]


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


def test_one_that_nobody_asked_for_is_raised_at_the_end() -> None:
    with pytest.raises(KeyboardInterrupt), noted_interrupts():
        signal.raise_signal(signal.SIGINT)


def test_a_second_one_is_raised_at_once() -> None:
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


def test_one_that_comes_while_the_network_is_loaded_waits_until_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """PyTorch aborts the process if a KeyboardInterrupt is raised in the midst of its import."""
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
