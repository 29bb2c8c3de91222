"""Misses that come in runs: against sums over every sequence of hidden states."""

from itertools import product

import numpy as np
import pytest
from worlds.drives.open_room import make_room
from worlds.same_beliefs import assert_same

from semantic_slam import Configuration, Detection, Engine, Keyframe, MapPrior
from semantic_slam.contracts.forgetful_pool import ForgetfulPool
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.states.miss_runs import MissRuns
from semantic_slam.inference.world.map_prior import ObjectPrior

RUNS = MissRuns(detection_probability=0.36, persistence=0.7)


def probability(outcomes: tuple[bool, ...]) -> float:
    """Of detections and misses of an object in view, summed over whether it was detectable in each keyframe."""
    total = 0.0
    for states in product((False, True), repeat=len(outcomes)):
        weight, before = 1.0, None
        for detectable, seen in zip(states, outcomes, strict=True):
            expected = RUNS.share if before is None else RUNS.share + RUNS.persistence * (before - RUNS.share)
            weight *= expected if detectable else 1.0 - expected
            hit = RUNS.hit if detectable else 0.0
            weight *= hit if seen else 1.0 - hit
            before = float(detectable)
        total += weight
    return total


@pytest.mark.parametrize("looks", [0, 1, 2, 5])
def test_first_detections_after_looks_are_the_sum_over_all_hidden_states(looks: int) -> None:
    """One look in every keyframe so far, and a detection in this one."""
    found = RUNS.still_undetected(np.ones((looks, 1, 1)), np.ones((looks, 1), dtype=int))
    assert found == pytest.approx(probability((False,) * looks + (True,)) / 0.36)


def test_between_looks_an_object_may_become_detectable() -> None:
    """Two keyframes long nobody looks: those outcomes are summed over, too."""
    found = RUNS.still_undetected(np.ones((2, 1, 1)), np.array([[3], [1]]))
    unseen = [(False, *between, False, True) for between in product((False, True), repeat=2)]
    assert found == pytest.approx(sum(map(probability, unseen)) / 0.36)


@pytest.mark.parametrize("outcomes", list(product((False, True), repeat=4)))
def test_the_engine_weighs_detections_and_misses_as_the_hidden_chain_does(outcomes: tuple[bool, ...]) -> None:
    def log_evidence(persistence: float) -> float:
        region = {"field_of_view_rad": 2.0, "max_range_m": 6.0, "occluder_radius_m": 0.0, "iterate_updates": False}
        rates = {"detection_probability": 0.36, "clutter_per_frame": 1e-9, "birth_density": 1e-9}
        configuration = Configuration.of(
            association="open",
            semantic_model={"kind": "none"},
            open_world={**region, **rates, "miss_persistence": persistence},
        )
        prior = MapPrior((ObjectPrior.planar(0, 2.0, 0.0, sigma_m=0.01, sigma_rad=1.0),))
        engine = Engine(configuration, prior, initial_covariance=np.diag([1e-6] * 3))
        sight = Detection(range_m=2.0, bearing_rad=0.0, covariance=np.diag([0.1, 0.03]) ** 2)
        for k, seen in enumerate(outcomes):
            detections = [sight] if seen else []
            engine.process(Keyframe.planar(k, detections=detections, motion_sigmas=(1e-4,) * 3))
        return engine.log_evidence

    independent = np.prod([0.36 if seen else 0.64 for seen in outcomes])
    found = log_evidence(0.7) - log_evidence(0.0)
    assert found == pytest.approx(np.log(probability(outcomes) / independent), abs=1e-6)


@pytest.mark.parametrize("range_m", [2.0, None])
@pytest.mark.parametrize("outcomes", [(True, False, False, True), (False, True, True, False), (False,) * 4])
def test_in_space_too_points_and_rays_are_weighed_as_the_hidden_chain_does(
    outcomes: tuple[bool, ...], range_m: float | None
) -> None:
    def log_evidence(persistence: float) -> float:
        rates = {"detection_probability": 0.36, "clutter_per_frame": 1e-9, "birth_density": 1e-9}
        configuration = Configuration.of(
            association="open",
            state_space="spatial",
            observation="points",
            semantic_model={"kind": "none"},
            open_world={**rates, "occluder_radius_m": 0.0, "miss_persistence": persistence},
        )
        pose = np.array([2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
        there = ObjectPrior(
            object_id=0,
            name="cup",
            pose=pose,
            covariance=np.diag([1e-6, 1e-6, 1e-6, 0.0, 0.0, 0.0]),
            class_probabilities={},
        )
        engine = Engine(
            configuration, MapPrior((there,)), initial_pose=np.eye(7)[6], initial_covariance=1e-8 * np.eye(6)
        )
        sigma_m = None if range_m is None else 0.01
        sight = Detection.along([1.0, 0.0, 0.0], range_m, sigma_range_m=sigma_m, ray_covariance=1e-6 * np.eye(3))
        for k, seen in enumerate(outcomes):
            detections = [sight] if seen else []
            engine.process(Keyframe.spatial(k, detections=detections, motion_covariance=1e-8 * np.eye(6)))
        return engine.log_evidence

    independent = np.prod([0.36 if seen else 0.64 for seen in outcomes])
    found = log_evidence(0.7) - log_evidence(0.0)
    assert found == pytest.approx(np.log(probability(outcomes) / independent), abs=1e-6)


def test_a_lineage_is_rebuilt_with_its_runs() -> None:
    room = make_room(14, 0, clutter=0.05, open_world={"miss_persistence": 0.7})
    whole = Engine.of_run(room.run, InProcessPool(2))
    divided = Engine.of_run(room.run, ForgetfulPool(2))
    for keyframe in room.keyframes:
        assert_same(divided.process(keyframe), whole.process(keyframe))
