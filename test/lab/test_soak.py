"""A long run holds no more than a short one, and what it has summarised is what the whole graph says."""

import errno
import os
from itertools import islice
from typing import Any

import numpy as np
import pytest
from semantic_slam_lab.soak.comparison import compared
from semantic_slam_lab.soak.measures import held
from semantic_slam_lab.soak.robots import robot
from semantic_slam_lab.soak.tour import Tour

from semantic_slam.inference.backend import Backend
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.expander import Expander, Expansion
from semantic_slam.inference.hypotheses import redistributed
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.pool import InProcessPool

HORIZON = 24


@pytest.fixture(scope="module")
def toured() -> tuple[Engine, list[dict[str, int]]]:
    """A run, and what it held after one and after two rounds of the building."""
    engine, counts = Engine(robot("given", HORIZON), backends=2), []
    for number, seen in enumerate(islice(Tour(robot("given")).keyframes(), 170), start=1):
        engine.process(seen.keyframe)
        if number in (84, 168):
            counts.append(held(engine))
    return engine, counts


@pytest.mark.long
def test_what_a_run_holds_does_not_grow_with_its_keyframes(toured: tuple[Engine, list[dict[str, int]]]) -> None:
    _, (before, after) = toured
    for name in ("variables", "steps"):
        assert after[name] == before[name]
    assert after["slots"] <= 1.2 * before["slots"]  # as many detections as there are in so many keyframes


def test_the_components_of_a_backend_that_is_gone_are_rebuilt_from_checkpoints_to_the_bit(
    toured: tuple[Engine, list[dict[str, int]]], monkeypatch: pytest.MonkeyPatch
) -> None:
    engine, _ = toured
    assert isinstance(engine.pool, InProcessPool)
    gone, other = engine.pool._backends
    replayed, expand = [], Expander.expand

    def counted(own: Expander, step: Step, *others: Any) -> Expansion:
        replayed.append(step.index)
        return expand(own, step, *others)

    monkeypatch.setattr(Expander, "expand", counted)
    moved = redistributed(engine.live, [other.backend_id])
    last = engine.hypotheses.num_keyframes - 1
    other.commit(engine.hypotheses.commit(engine.run.run_id, last, moved, always_lineage=True))
    assert moved.keys() == other.held.keys()
    for number in moved:
        ours, theirs = (backend.held[number].component.smoother for backend in (other, gone))
        assert np.array_equal(ours.isam.getDelta().vector(), theirs.isam.getDelta().vector())
        assert ours.isam.getLinearizationPoint().equals(theirs.isam.getLinearizationPoint(), 0.0)
    assert last - min(replayed) < HORIZON


def alone(engine: Engine) -> Backend:
    """A backend that shares no checkpoints and knows 60 keyframes of the run."""
    found = Backend(0)
    found.start(engine.run)
    for seen in islice(Tour(robot("given")).keyframes(), 60):
        found.learn(seen.keyframe)
    return found


@pytest.mark.long
def test_a_backend_that_shares_no_checkpoints_keeps_older_keyframes_on_disk_and_replays_them_to_the_bit() -> None:
    engine = Engine(robot("given", HORIZON))
    for seen in islice(Tour(robot("given")).keyframes(), 60):
        engine.process(seen.keyframe)
    late = alone(engine)
    assert late.steps.num_on_disk == 60 - HORIZON
    late.commit(engine.hypotheses.commit(engine.run.run_id, 59, engine.live, always_lineage=True))
    assert isinstance(engine.pool, InProcessPool) and engine.live
    for number in engine.live:
        ours, theirs = late.held[number].component.smoother, engine.pool.component(number).smoother
        assert np.array_equal(ours.isam.getDelta().vector(), theirs.isam.getDelta().vector())


def test_on_a_full_disk_keyframes_stay_in_memory(
    toured: tuple[Engine, list[dict[str, int]]], monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "pwrite", full)
    kept = alone(toured[0]).steps
    assert (len(kept), kept.num_on_disk) == (60, 0)
    assert [kept[k].index for k in (0, 59)] == [0, 59]
    assert kept.disk_fault == "No space left on device"


@pytest.mark.long
def test_a_summary_is_off_by_less_than_a_fifth_of_a_standard_deviation() -> None:
    for row in compared(robot("given", HORIZON), 100, seed=0, every=50):
        assert row.shift <= 0.2
        assert 0.95 <= row.least_ratio <= row.largest_ratio <= 1.05
