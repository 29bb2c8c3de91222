"""A robot that is lost on a map finds itself where the map allows it, and says so where it does not."""

import numpy as np
import pytest
from worlds.same_beliefs import assert_same
from worlds.scenes.lost_world import PLACES, SYMMETRIC, configuration, errors, make_world, map_of, run

from semantic_slam import Engine
from semantic_slam.evaluation.history import histories
from semantic_slam.geometry import se2
from semantic_slam.geometry.moments import matched_moments
from semantic_slam.inference.building import make_run_configuration, start_of_run
from semantic_slam.inference.pool import InProcessPool

START = np.array([4.0, -7.0, 1.9])


@pytest.mark.long
def test_a_lost_robot_finds_itself_among_points_that_look_alike() -> None:
    world = make_world(START, 12)
    engine, beliefs = run(world, configuration())
    last, weights = beliefs[-1], np.exp(beliefs[-1].log_weights)
    near = errors(last, world.truth[-1]) < 0.3
    assert weights[near].sum() > 0.99
    best = next(iter(engine.live.values()))
    pairs = zip(best.lineage, world.names, strict=True)
    named = [pair for step, names in pairs for pair in zip(step.association, names, strict=True)]
    assert np.mean([number == name for number, name in named]) > 0.9
    assert {n for n, _ in named} <= set(range(len(PLACES)))


def test_a_lost_robot_finds_itself_though_a_quarter_of_what_is_on_the_map_has_left() -> None:
    world = make_world(START, 12, places=np.delete(PLACES, [2, 3], axis=0))
    _, beliefs = run(world, configuration(rates={"departed_share": 0.05}))
    assert np.exp(beliefs[-1].log_weights)[errors(beliefs[-1], world.truth[-1]) < 0.5].sum() > 0.5


def test_beliefs_tell_the_history_of_a_robot_that_was_placed() -> None:
    engine, beliefs = run(make_world(START, 8), configuration())
    told = histories(beliefs)
    assert any(engine.problem.is_placed(live.lineage) for live in engine.live.values())
    for row, live in enumerate(engine.live.values()):
        assert [tuple(found[row].tolist()) for found in told] == [step.association for step in live.lineage]


def test_until_then_it_says_that_it_may_be_anywhere() -> None:
    world = make_world(START, 1)
    _, (belief,) = run(world, configuration())
    mean, covariance = matched_moments(np.exp(belief.log_weights), belief.poses, belief.pose_covariances)
    offset = world.truth[0, :2] - mean[:2]
    assert offset @ np.linalg.solve(covariance[:2, :2], offset) < 9.0
    assert np.sqrt(np.diag(covariance)[[0, 1, 5]]) == pytest.approx([10.0, 10.0, 3.14], rel=0.05)
    assert np.nanmax(belief.association_probabilities[:, : len(PLACES)]) == 0.0


def test_a_robot_beside_the_map_is_not_placed_on_it() -> None:
    elsewhere = np.array([[2.0, 0.5], [4.5, 2.0], [1.5, 5.0], [6.0, 6.5], [3.0, 8.0], [-2.0, 3.0]]) * 1.1
    world = make_world(np.array([1.0, -2.0, 1.0]), 12, places=elsewhere)
    engine, beliefs = run(world, configuration())
    placed = [engine.problem.is_placed(live.lineage) for live in engine.live.values()]
    assert np.exp(beliefs[-1].log_weights)[placed].sum() < 0.1


@pytest.mark.long
def test_a_map_that_looks_the_same_after_half_a_turn_leaves_it_undecided() -> None:
    world = make_world(np.array([4.0, -3.0, 1.9]), 12, places=SYMMETRIC)
    any_heading = {"sigma": [10.0, 10.0, 6.28]}
    engine, beliefs = run(world, configuration(initial_pose=any_heading), SYMMETRIC)
    turned = se2.compose(np.array([0.0, 0.0, np.pi]), world.truth[-1])
    weights = np.exp(beliefs[-1].log_weights)
    here, there = (weights[errors(beliefs[-1], pose) < 0.3].sum() for pose in (world.truth[-1], turned))
    assert here == pytest.approx(0.5, abs=1e-6)
    assert there == pytest.approx(0.5, abs=1e-6)
    assert len(engine.live) >= 2


@pytest.mark.long
@pytest.mark.parametrize(("sigma", "most"), [([10.0, 10.0, 3.0], 2), ([0.9, 0.9, 0.2], 10)], ids=["lost", "known"])
def test_fewer_hypotheses_are_followed_of_a_robot_that_was_lost(sigma: list[float], most: int) -> None:
    revision = {"lost_every_keyframes": 2, "lost_hypotheses": 2}
    ambiguous = {"detection_probability": 0.5, "clutter_per_frame": 1.0}
    pruning = {"max_hypotheses": 10, "ratio": 1e12}
    start = {"sigma": sigma}
    settings = configuration(rates=ambiguous, initial_pose=start, revision=revision, pruning=pruning)
    _, beliefs = run(make_world(np.zeros(3), 6), settings)
    assert max(len(belief.hypotheses) for belief in beliefs) == most


@pytest.mark.long
@pytest.mark.slow
def test_a_robot_that_was_lost_is_the_same_in_any_number_of_backends() -> None:
    settings = configuration()
    prior = make_run_configuration(settings, map_of(), *start_of_run(settings, None, None), stamp_ns=0)
    one, two = (Engine.of_run(prior, InProcessPool(number)) for number in (1, 2))
    for keyframe in make_world(START, 10).keyframes:
        assert_same(two.process(keyframe), one.process(keyframe))
