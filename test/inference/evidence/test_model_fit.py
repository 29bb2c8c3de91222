"""Whether a belief explains its data: the posterior of the reference model, its false alarms and its delay."""

import json
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike
from scipy.stats import qmc
from worlds.drives.open_room import make_room
from worlds.scenes.planar_world import World, make_world

from semantic_slam.configuration import OpenWorldConfiguration
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.building import reference_of
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.evidence.model_fit import (
    PRIOR,
    WINDOW_KEYFRAMES,
    ModelFit,
    mean_of_known,
    probability_unexplained,
)
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.models.sensed_region import SensedRegion
from semantic_slam.inference.open_world.planar.detection_probability import undetected_share
from semantic_slam.inference.open_world.planar.region import SensorRegion
from semantic_slam.inference.open_world.planar.unseen_ground import first_detections
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.protocol import RunConfiguration
from semantic_slam.inference.reference import ScoreDensity
from semantic_slam.inference.states.detection_rates import DetectionRates
from semantic_slam.viewpoint.parametric import ParametricModel

SEEDS = range(4)
NOTHING_WRONG: dict[str, Any] = {
    "semantic_model": {"kind": "parametric", "outlier_share": 0.0},
    "closed_world": {"clutter_per_frame": 0.0},
}
KEYFRAMES = 16


def beliefs_of(run: RunConfiguration, keyframes: list[Keyframe]) -> list[HybridBelief]:
    engine = Engine.of_run(run, InProcessPool(1))
    return [engine.process(keyframe) for keyframe in keyframes]


def unexplained(run: RunConfiguration, keyframes: list[Keyframe]) -> Array:
    return np.array([belief.unexplained for belief in beliefs_of(run, keyframes)])


@cache
def rightly(kind: str, seed: int) -> list[HybridBelief]:
    """Of a drive on a known map under the model that it is drawn from."""
    world = make_world(KEYFRAMES, seed, semantic_model={"kind": kind})
    return beliefs_of(world.run, world.keyframes)


def test_the_posterior_is_that_of_all_beginnings_written_out() -> None:
    own, reference = np.random.default_rng(0).normal([[-4.0], [-6.0]], 3.0, size=(2, 25))
    stream = ModelFit()
    for k in range(len(own)):
        window = slice(max(k + 1 - WINDOW_KEYFRAMES, 0), k + 1)
        p, q = np.exp(own[window]), np.exp(reference[window])
        hazard = PRIOR / WINDOW_KEYFRAMES
        lost = [hazard * np.prod(p[:at]) * np.prod(q[at:]) for at in range(len(p))]
        expected = sum(lost) / (sum(lost) + (1.0 - hazard * len(p)) * np.prod(p))
        assert stream.add(own[k], reference[k]) == pytest.approx(expected, rel=1e-9)


def test_evidence_that_is_not_known_says_nothing() -> None:
    assert np.isnan(probability_unexplained(np.array([0.0, np.nan])))
    assert probability_unexplained(np.array([1e6])) == 1.0 and probability_unexplained(np.array([-1e6])) == 0.0


def test_the_mean_is_over_what_is_known() -> None:
    assert mean_of_known(np.array([1.0, np.nan, 4.0]), np.array([0.5, 0.3, 0.2])) == pytest.approx(1.3 / 0.7)
    assert np.isnan(mean_of_known(np.array([np.nan]), np.ones(1)))


def test_scores_of_no_class_have_the_moments_of_all_classes() -> None:
    model = ParametricModel(0.5, 15.0)
    found = ScoreDensity.of_classes(model, 1.0)
    samples = np.random.default_rng(1).multivariate_normal(found.mean, found.covariance, 10)
    assert samples.shape == (10, model.num_features) and np.linalg.eigvalsh(found.covariance).min() > 0.0


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize("kind", ["none", "parametric"])
def test_a_right_model_raises_no_alarm_with_a_known_map(kind: str) -> None:
    for seed in SEEDS:
        assert max(belief.unexplained for belief in rightly(kind, seed)) < 0.01


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize(
    "values", [{"association": "given"}, {"association": "given", "weights": {"method": "laplace"}}]
)
def test_objects_named_for_the_first_time_raise_no_alarm(values: dict[str, object]) -> None:
    for seed in SEEDS[:2]:
        world = make_world(KEYFRAMES, seed, **values)
        assert unexplained(world.run, world.keyframes).max() < 0.01


@pytest.mark.long
@pytest.mark.slow
def test_a_right_model_raises_no_alarm_in_an_open_world() -> None:
    for seed in SEEDS:
        room = make_room(20, seed)
        assert unexplained(room.run, room.keyframes).max() < 0.5


def without_object(world: World) -> tuple[RunConfiguration, list[Keyframe]]:
    """The third object is not on the map; the robot comes near it after five keyframes."""
    prior = json.loads(world.run.map_prior)
    prior["objects"] = [entry for entry in prior["objects"] if entry["id"] != 2]
    return replace(world.run, map_prior=json.dumps(prior)), world.keyframes


def carried(world: World) -> tuple[RunConfiguration, list[Keyframe]]:
    """Two metres that odometry does not tell, after six keyframes."""
    kept = world.keyframes[:6] + world.keyframes[10:]
    return world.run, [replace(keyframe, index=k) for k, keyframe in enumerate(kept)]


def noisier(world: World) -> tuple[RunConfiguration, list[Keyframe]]:
    """Errors of range and bearing of four times the stated size."""
    return with_errors(world.keyframes, np.array([0.1, 0.05]) * np.sqrt(15.0), world.run)


def with_errors(
    keyframes: list[Keyframe], sigmas: ArrayLike, run: RunConfiguration
) -> tuple[RunConfiguration, list[Keyframe]]:
    """Detections with errors of range and bearing besides, by their standard deviations."""
    random = np.random.default_rng(7)
    found = []
    for keyframe in keyframes:
        seen = keyframe.measurements
        errors = random.normal(size=(len(seen), 2)) * sigmas
        noisy = replace(
            seen,
            ranges_m=np.maximum(seen.ranges_m + errors[:, 0], 0.1),
            bearings_rad=seen.bearings_rad + errors[:, 1],
        )
        found.append(replace(keyframe, measurements=noisy))
    return run, found


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize(
    ("misspecified", "begins", "delay"), [(without_object, 5, 3), (carried, 6, 1), (noisier, 0, 8)]
)
def test_a_wrong_model_is_found_out(
    misspecified: Callable[[World], tuple[RunConfiguration, list[Keyframe]]], begins: int, delay: int
) -> None:
    """Under models without tails: with clutter an object that the map lacks, or a gross error, is explained."""
    for seed in SEEDS:
        found = unexplained(*misspecified(make_world(KEYFRAMES + 2, seed, **NOTHING_WRONG)))
        alarms = np.flatnonzero(found > 0.5)
        assert len(alarms) and begins <= alarms[0] <= begins + delay


@pytest.mark.long
@pytest.mark.slow
def test_a_belief_that_does_not_explain_its_data_keeps_what_it_would_have_pruned() -> None:
    room = make_room(10, 3)
    run, keyframes = with_errors(room.keyframes, [0.4, 0.12], room.run)
    found = [(belief.unexplained, float(np.ptp(belief.log_weights))) for belief in beliefs_of(run, keyframes)]
    doubt, spread = np.array(found).T
    limit = np.log(Engine.of_run(run, InProcessPool(1)).problem.pruning.ratio)
    doubted = doubt[:-1] > 0.5
    assert spread[1:][doubted].max() > limit
    assert spread[1:][~doubted].max() <= limit / (1.0 - doubt[:-1][~doubted].max())


@pytest.mark.slow
def test_innovations_of_a_right_model_have_their_size() -> None:
    """One on average, within four standard deviations of a mean of chi-square variables with two degrees each."""
    found = []
    for seed in SEEDS:
        found += [belief.innovation_nees for belief in rightly("none", seed)[2:]]
    assert np.mean(found) == pytest.approx(1.0, abs=4.0 * np.sqrt(0.5 / len(found)))


def test_innovations_are_of_known_objects_alone() -> None:
    room = make_room(6, 0)
    first = beliefs_of(room.run, room.keyframes)[0]
    assert len(first.detection_ids) and np.isnan(first.innovation_nees)


def test_the_reference_of_no_detections_in_a_closed_world_is_certain() -> None:
    world = make_world(2)
    engine = Engine.of_run(world.run, InProcessPool(1))
    belief = engine.process(world.keyframes[0])
    empty = replace(world.keyframes[0], measurements=world.keyframes[0].measurements.take(np.zeros(0, dtype=int)))
    step = engine.problem.reader.step(empty)
    assert reference_of(world.run, engine.problem).log_density(step, belief) == 0.0


def reference_of_first(**open_world: object) -> float:
    """Log density of the first keyframe of a room under the reference."""
    room = make_room(1, 0, clutter=0.0, open_world=open_world)
    engine = Engine.of_run(room.run, InProcessPool(1))
    belief = engine.process(room.keyframes[0])
    return reference_of(room.run, engine.problem).log_density(engine.problem.reader.step(room.keyframes[0]), belief)


def test_the_reference_fills_the_region_that_is_learned() -> None:
    """Else detections beyond a region that means nothing would have too large a density under it."""
    seen = make_room(1, 0, clutter=0.0).keyframes[0].measurements
    sensed = SensedRegion.of(seen.ranges_m, seen.bearings_rad)
    assert sensed is not None
    told = {
        name.removeprefix("open_world."): getattr(sensed, name.removeprefix("open_world.")) for name in sensed.named()
    }
    assert reference_of_first(learn_region=True) == pytest.approx(reference_of_first(**told), rel=1e-12)


def test_the_reference_expects_as_many_detections_as_evidence_may_choose_from() -> None:
    single = [reference_of_first(birth_density=own) for own in (0.01, 0.5)]
    assert reference_of_first(birth_densities=[0.01, 0.5]) == pytest.approx(
        np.logaddexp(*single) - np.log(2.0), rel=1e-12
    )


@pytest.mark.parametrize("persistence", [0.0, 0.8])
def test_the_ground_not_seen_yet_is_the_mean_over_the_region(persistence: float) -> None:
    rates = DetectionRates.of(
        OpenWorldConfiguration(miss_persistence=persistence, detection_half_ranges_m=(4.0,), birth_density=0.1)
    )
    region = SensorRegion(min_range_m=0.3, max_range_m=5.0, field_of_view_rad=1.6, direction_rad=0.7)
    random, robot = np.random.default_rng(2), np.array([0.5, 0.2, 0.3])
    draws = qmc.Sobol(2, seed=0).random_base2(11)
    ranges, turns = np.sqrt(0.3**2 + draws[:, 0] * (25.0 - 0.3**2)), 1.6 * (draws[:, 1] - 0.5) + 0.7 + robot[2]
    points = robot[:2] + ranges[:, None] * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    found = 0.1 * 0.9 * 0.5 ** (ranges / 4.0) ** 2
    afresh = region.area_m2 * found.mean()
    ratios = []
    for _ in range(10):
        trail = random.normal(size=(12, 3)) * [1.0, 1.0, 0.5]
        left = np.maximum(undetected_share(region, rates, trail, points)[:, 0], 0.02)
        expected = region.area_m2 * (left * found).mean()
        told, at_points = first_detections(region, rates, trail, robot, points, 0.02)
        assert at_points.mean() * region.area_m2 == pytest.approx(expected) and expected < 0.9 * afresh
        ratios.append(told[0] / expected)
    assert np.sqrt(np.mean(np.square(np.log(ratios)))) < 0.2
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.12)
    assert first_detections(region, rates, trail[:0], robot, points, 0.02)[0] == pytest.approx(afresh, rel=0.03)
    assert first_detections(region, rates, trail, robot, points, 1.0)[0] == pytest.approx(afresh, rel=0.03)


def test_a_problem_of_unknown_detections_has_no_reference() -> None:
    world = make_world(2)
    problem = Engine.of_run(world.run, InProcessPool(1)).problem
    engine = Engine.of_run(world.run, InProcessPool(1, problem), problem)
    assert np.isnan(engine.process(world.keyframes[0]).unexplained)
