"""Where a map fits objects that a robot has mapped by itself, and how likely what it missed of them is."""

from itertools import pairwise, product

import numpy as np
import pytest
from worlds.scenes.lost_world import PLACES, configuration, make_world, map_of

from semantic_slam import Engine, Keyframe
from semantic_slam.configuration import OpenWorldConfiguration
from semantic_slam.geometry import se2
from semantic_slam.inference.open_world.planar.region import SensorRegion
from semantic_slam.inference.open_world.planar.sightings import Sightings
from semantic_slam.inference.relocation.constellation import Fitting, Places, positions
from semantic_slam.inference.relocation.placements import Placements
from semantic_slam.inference.relocation.stretches import parted, stretches
from semantic_slam.inference.revision.replay import Replay
from semantic_slam.inference.states.detection_rates import DetectionRates
from semantic_slam.inference.states.lineage import LineageStep
from semantic_slam.inference.states.miss_runs import MissRuns

T_MAP_OWN = np.array([3.0, -2.0, 2.1])


def fitting(own: Places, places: np.ndarray = PLACES, together: list[int] | None = None) -> Fitting:
    return Fitting(
        own=own,
        map_points=places,
        map_covariances=np.tile(1e-4 * np.eye(2), (len(places), 1, 1)),
        log_new=float(np.log(0.03)),
        log_prior=lambda motions: np.full(motions.shape[:-1], -8.0),
        stretches=np.zeros(len(own.points), dtype=int) if together is None else np.array(together),
    )


def own_places(numbers: list[int], sigma: float = 0.02, shared: float = 0.0) -> Places:
    """Points of the map in the robot's frame, with errors of their own and some that all share."""
    poses = np.column_stack([PLACES[numbers], np.zeros(len(numbers))])
    there = se2.between(np.broadcast_to(T_MAP_OWN, poses.shape), poses)[:, :2]
    noise = np.random.default_rng(2).normal(size=there.shape) * sigma
    common = np.kron(np.ones((len(numbers),) * 2), np.eye(2)) * shared**2
    return Places(there + noise, sigma**2 * np.eye(2 * len(numbers)) + common)


def test_objects_are_named_and_the_motion_is_found() -> None:
    numbers = [0, 2, 3, 5, 6]
    best = fitting(own_places(numbers)).best(4)[0]
    np.testing.assert_allclose(best.T_map_own, T_MAP_OWN, atol=0.05)
    assert best.names == dict(enumerate(numbers))


def test_twins_are_told_apart_by_the_errors_that_they_do_not_share() -> None:
    numbers = [0, 1, 3, 4, 6]
    best = fitting(own_places(numbers, sigma=0.02, shared=0.3)).best(4)[0]
    assert best.names == dict(enumerate(numbers))


def test_an_object_of_another_stretch_may_have_the_same_name() -> None:
    numbers = [0, 2, 3, 5, 3]
    one_to_one = fitting(own_places(numbers)).best(1)[0]
    assert len(set(one_to_one.names.values())) == len(one_to_one.names)
    parted_fit = fitting(own_places(numbers), together=[0, 0, 0, 0, 1]).best(1)[0]
    assert parted_fit.names == dict(enumerate(numbers))


def test_a_fit_weighs_the_integral_over_all_motions() -> None:
    own, numbers = own_places([0, 2, 5], sigma=0.1), [0, 2, 5]
    fit = fitting(own).weighed(T_MAP_OWN, dict(enumerate(numbers)))
    axes = [np.linspace(-w, w, 31) for w in (0.5, 0.5, 0.12)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3) + fit.T_map_own
    points = np.column_stack([own.points, np.zeros(3)])
    log_density = np.full(len(grid), -8.0 - 3.0 * np.log(0.03))
    for point, place in zip(points, PLACES[numbers], strict=True):
        moved = se2.compose(grid, np.broadcast_to(point, grid.shape))[:, :2]
        variance = 0.1**2 + 1e-4
        log_density += -0.5 * ((moved - place) ** 2).sum(axis=1) / variance - np.log(2.0 * np.pi * variance)
    expected = np.logaddexp.reduce(log_density) + np.log(np.prod([axis[1] - axis[0] for axis in axes]))
    assert fit.log_gain == pytest.approx(expected, abs=0.02)


def test_positions_have_their_covariance_along_the_axes_of_the_frame() -> None:
    states = np.array([[1.0, 2.0, np.pi / 2.0], [0.0, 0.0, 0.0]])
    tangent = np.diag([0.04, 0.01, 1.0, 0.09, 0.16, 1.0])
    tangent[0, 3] = tangent[3, 0] = 0.02
    found = positions(states, tangent)
    expected = np.diag([0.01, 0.04, 0.09, 0.16])
    expected[1, 2] = expected[2, 1] = 0.02  # forward of the first is upward
    np.testing.assert_allclose(found.covariance, expected, atol=1e-12)


def test_runs_of_misses_weigh_the_sum_over_what_cannot_be_seen() -> None:
    region = SensorRegion(min_range_m=0.1, max_range_m=5.0, field_of_view_rad=6.28)
    rates = DetectionRates.of(OpenWorldConfiguration(detection_probability=0.3, miss_persistence=0.7))
    own, chain = Sightings(path=np.zeros((5, 3)), regions=[region] * 5, sensors=rates), MissRuns(0.3, 0.7)
    detected = np.array([False, True, True, False, False])
    view = own.in_view(np.array([2.0, 1.0]))
    found = own.log_likelihoods(view, detected, np.array(-1))
    hidden = 0.0
    for states in product([0, 1], repeat=5):
        share = [1.0 - float(chain.share), float(chain.share)]
        weight = share[states[0]]
        for before, after in pairwise(states):
            weight *= share[after] + 0.7 * (float(before == after) - share[after])
        for state, seen in zip(states, detected, strict=True):
            weight *= (chain.hit if seen else 1.0 - chain.hit) if state else float(not seen)
        hidden += weight
    np.testing.assert_allclose(found, [np.log(hidden)], atol=1e-3)


def test_after_a_blind_stretch_everything_may_be_new() -> None:
    lineage = (LineageStep((3, 4), (-1, -1)), LineageStep((3,), (-1,)), LineageStep((7, 3), (-1, -1)))
    found = parted(lineage, np.array([0, 0, 1]), lambda keyframe: 10 * keyframe)
    assert [step.association for step in found] == [(3, 4), (3,), (7, 21)]
    assert parted(lineage, np.array([0, 0, 0]), lambda keyframe: 10 * keyframe) == lineage


def test_a_stretch_is_blind_where_a_motion_or_a_turn_is_badly_known() -> None:
    engine = Engine(configuration())
    sigmas = [(0.02, 0.02, 0.01), (0.6, 0.6, 0.01), (0.02, 0.02, 0.2), (0.02, 0.02, 0.01)]
    steps = [engine.problem.reader.step(Keyframe.planar(k, motion_sigmas=own)) for k, own in enumerate(sigmas)]
    assert stretches(steps).tolist() == [0, 1, 2, 2]


def test_a_history_that_ends_is_followed_where_it_is_likeliest_to_go_on() -> None:
    world = make_world(np.array([4.0, -7.0, 1.9]), 6)
    engine = Engine(configuration(), map_of())
    for keyframe in world.keyframes:
        engine.process(keyframe)
    lost = engine.relocation._lost
    assert lost is not None
    assert all(engine.problem.is_placed(live.lineage) for live in engine.live.values())
    replay = Replay(engine.problem, engine.association(engine.problem, engine.registry), engine.steps)
    found = replay.followed(lost.lineage)
    assert found is not None
    assert found.lineage[: len(lost.lineage)] == lost.lineage
    assert len(found.lineage) == len(engine.steps)
    assert not engine.problem.is_placed(found.lineage)


def test_what_a_placement_promises_is_what_it_weighs_though_objects_of_the_map_have_left() -> None:
    world = make_world(np.array([4.0, -7.0, 1.9]), 12, places=np.delete(PLACES, [2, 3], axis=0))
    never_looks = {"lost_every_keyframes": 100}
    engine = Engine(configuration(rates={"departed_share": 0.05}, revision=never_looks), map_of())
    for keyframe in world.keyframes:
        engine.process(keyframe)
    replay = Replay(engine.problem, engine.association(engine.problem, engine.registry), engine.steps)
    lost, starts = replay.followed(next(iter(engine.live.values())).lineage), engine.problem.starts
    assert lost is not None and starts is not None
    placements = Placements(
        problem=engine.problem,
        starts=starts,
        steps=engine.steps,
        lineage=lost.lineage,
        component=lost.component,
        expected_births=lost.expected_births,
    )
    found = placements.best(4, set())
    assert len(found) > 1
    for own in found:
        replayed = replay.followed(own.lineage)
        assert replayed is not None
        assert replayed.log_joint - lost.log_joint == pytest.approx(own.log_gain, abs=1.0)
