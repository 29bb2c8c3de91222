"""Detections of an object weigh as much as the hypotheses that have them, times its existence in these."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from worlds.belief_factory import CLASSES, measurements_at, run_configuration, small_belief

from semantic_slam.configuration import Configuration
from semantic_slam.evaluation.record import Record
from semantic_slam.evaluation.trajectory import Trajectory
from semantic_slam.training.detection.looks import looks_of
from semantic_slam.training.runs import Run
from semantic_slam.training.sightings import sightings_of

WEIGHTS = (0.7, 0.3)


def run_of_two_hypotheses(new_exists: float) -> Run:
    """In two keyframes, one detection each: of a new object, 2, or of a mapped one, 1, which exists in any case.

    The new one exists with ``new_exists`` in the hypothesis that has it, and the other hypothesis knows nothing of it.
    """
    marginal = np.array([1.0, WEIGHTS[0] * new_exists])
    beliefs = [
        replace(small_belief(k, ids, parents, WEIGHTS, (1, 2), [[1], [0]]), existence=marginal)
        for k, (ids, parents) in enumerate([((10, 11), (0, 1)), ((20, 21), (10, 11))])
    ]
    record = Record(
        run=run_configuration(Path("source"), CLASSES, ("",) * 7),
        beliefs=tuple(beliefs),
        odometry=Trajectory(np.zeros(0, dtype=np.int64), np.zeros((0, 7))),
        measurements={own.stamp_ns: measurements_at(own.keyframe, [0], CLASSES) for own in beliefs},
        truth=None,
    )
    return Run(record=record, configuration=Configuration(association="open"), bag="bag", sha256="")


@pytest.mark.parametrize("new_exists", [1.0, 0.8])
def test_the_weight_of_a_hypothesis_counts_once_in_that_of_what_it_sees(new_exists: float) -> None:
    """sum_h w_h P(exists | h), over the hypotheses with these detections, as enumerated by hand."""
    run = run_of_two_hypotheses(new_exists)
    exact = {2: WEIGHTS[0] * new_exists, 1: WEIGHTS[1]}
    found = sightings_of(run)
    assert {own.object_id: own.weight for own in found} == pytest.approx(exact)
    assert all(own.places == ((0, 0), (1, 0)) for own in found)
    looks = looks_of(run.record, run.configuration)
    assert looks is not None and sorted(looks.weights) == pytest.approx(sorted(exact.values()))
    np.testing.assert_array_equal(looks.is_known, [[False, False], [True, True]])


def test_looks_of_a_learned_region_are_those_of_the_same_region_stated() -> None:
    """By the bounds of the last belief; a region that detections have not shown is as stated."""
    run = run_of_two_hypotheses(1.0)
    bounds = {"min_range_m": 0.5, "max_range_m": 4.0, "field_of_view_rad": 1.1, "direction_rad": 0.2}
    names = tuple(f"open_world.{name}" for name in bounds)
    told = {"noise_names": names, "noise_values": np.array([*bounds.values()]), "noise_sigmas": np.full(4, np.nan)}
    first, last = run.record.beliefs
    learned = looks_of(
        replace(run.record, beliefs=(first, replace(last, **told))),
        Configuration.of(association="open", open_world={"learn_region": True}),
    )
    stated = looks_of(run.record, Configuration.of(association="open", open_world=bounds))
    assert learned is not None and stated is not None
    for name, values in vars(stated).items():
        np.testing.assert_array_equal(getattr(learned, name), values)
    assert learned.field_of_view_rad == bounds["field_of_view_rad"]
