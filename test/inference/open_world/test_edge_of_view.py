"""A robot at rest sees an object at the edge of its view in every frame or in none, by integrals over its place."""

from itertools import product
from typing import Any

import numpy as np
import pytest
from scipy.special import ndtr

from semantic_slam import Configuration, Detection, Engine, Keyframe
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior

HIT, EXISTS, RANGE_M, SIGMA_M = 0.9, 0.9, 4.0, 0.2
SELDOM = 0.6
"""Detection probability where misses come in runs."""
STILL = {
    name: 1e-5
    for name in (
        "sigma_translation_per_m",
        "sigma_rotation_per_m",
        "sigma_rotation_per_rad",
        "sigma_translation_floor_m",
        "sigma_rotation_floor_rad",
    )
}


def configuration(odometry: dict[str, float] = STILL, **open_world: Any) -> Configuration:
    """Of a robot that knows where it is."""
    return Configuration.of(
        association="open",
        semantic_model={"kind": "none"},
        initial_pose={"sigma": [1e-4, 1e-4, 1e-5]},
        odometry=odometry,
        open_world={
            "detection_probability": HIT,
            "clutter_per_frame": 1e-9,
            "birth_density": 1e-9,
            "field_of_view_rad": 3.0,
            "min_range_m": 0.0,
            "max_range_m": RANGE_M,
            "occluder_radius_m": 0.0,
        }
        | open_world,
    )


def beliefs(
    seen: list[bool], x_m: float, step_m: float = 0.0, at: Detection | None = None, **settings: Any
) -> list[HybridBelief]:
    """Of a robot ahead of which is an object, at ``x_m``, of which the map is not sure."""
    prior = MapPrior((ObjectPrior.planar(0, x_m, 0.0, sigma_m=SIGMA_M, sigma_rad=0.3, existence=EXISTS),))
    engine, found = Engine(configuration(**settings), prior), list[HybridBelief]()
    for k, is_seen in enumerate(seen):
        detections = [at or Detection.at(x_m, 0.0)] if is_seen else []
        found.append(engine.process(Keyframe.planar(k, detections=detections, motion=(k and step_m, 0.0, 0.0))))
    return found


def missed_among_runs(share: float, times: int, persistence: float) -> float:
    """Probability of ``times`` misses of an object that exists and is in view with a ``share``, over all runs."""
    hit, total = 0.9, 0.0
    often = SELDOM / hit
    for states in product([False, True], repeat=times):
        probability, before = 1.0, often
        for now in states:
            detectable = often + persistence * (before - often)
            probability *= detectable * (1.0 - hit) if now else 1.0 - detectable
            before = float(now)
        total += probability
    return share * total + 1.0 - share


def existence(inside: np.ndarray, weights: np.ndarray) -> float:
    """Of what was missed T times, for Q places (T, Q) that are in view or not, by their weights (Q,)."""
    missed = float((weights * (1.0 - HIT * inside).prod(axis=0)).sum() / weights.sum())
    return EXISTS * missed / (1.0 - EXISTS + EXISTS * missed)


@pytest.mark.parametrize("misses", [1, 2, 8, 20])
@pytest.mark.parametrize("sigmas_inside", [-1.0, 0.0, 1.5])
def test_misses_of_a_robot_at_rest_refute_what_is_in_view_alone(misses: int, sigmas_inside: float) -> None:
    belief = beliefs([False] * misses, RANGE_M - sigmas_inside * SIGMA_M)[-1]
    share = ndtr(sigmas_inside)
    weights, inside = np.array([share, 1.0 - share]), np.array([[1.0, 0.0]] * misses)
    assert belief.existence[0] == pytest.approx(existence(inside, weights), abs=0.003)
    if misses == 8 and sigmas_inside == 0.0:
        assert belief.existence[0] == pytest.approx(0.82, abs=0.003)


def test_a_robot_that_goes_past_an_object_has_looked_at_more_and_more_places() -> None:
    """It comes nearer by one standard deviation of the object's place per frame."""
    belief = beliefs([False] * 3, RANGE_M + SIGMA_M, step_m=SIGMA_M)[-1]
    place = np.linspace(-8.0, 8.0, 4001)
    inside = np.array([place < k - 1.0 for k in range(3)])
    assert belief.existence[0] == pytest.approx(existence(inside, np.exp(-0.5 * place**2)), rel=0.03)


@pytest.mark.parametrize("noise_m", [0.01, 0.05, 0.2])
def test_a_robot_at_rest_that_is_not_sure_to_be_is_between_both(noise_m: float) -> None:
    """The place relative to the robot is a random walk, drawn."""
    random, odometry = np.random.default_rng(0), STILL | {"sigma_translation_floor_m": noise_m}
    place = SIGMA_M * random.normal(size=100_000)
    inside = np.array([(place := place + noise_m * random.normal(size=len(place))) < 0.0 for _ in range(8)])
    belief = beliefs([False] * 8, RANGE_M, odometry=odometry)[-1]
    assert belief.existence[0] == pytest.approx(existence(inside, np.ones(len(place))), abs=0.03)


@pytest.mark.parametrize("sigmas_inside", [-1.0, 1.0])
def test_the_evidence_of_misses_is_that_of_the_integral(sigmas_inside: float) -> None:
    place, share = RANGE_M - sigmas_inside * SIGMA_M, ndtr(sigmas_inside)
    found = sum(belief.log_evidence for belief in beliefs([False] * 6, place))
    missed = share * (1.0 - HIT) ** 6 + 1.0 - share
    assert found == pytest.approx(np.log(1.0 - EXISTS + EXISTS * missed), abs=0.003)


def test_what_a_robot_at_rest_has_seen_is_in_view() -> None:
    """A miss after it has the probability 1 - p, wherever the object is."""
    seen = beliefs([True, False, False], RANGE_M + SIGMA_M, at=Detection.at(RANGE_M, 0.0))
    for belief in seen[1:]:
        assert belief.log_evidence == pytest.approx(np.log(1.0 - HIT), abs=0.03)


@pytest.mark.parametrize("sigmas_inside", [0.0, 1.0])
@pytest.mark.parametrize("misses", [2, 7])
def test_misses_in_runs_at_the_edge_are_the_sum_over_all_runs(sigmas_inside: float, misses: int) -> None:
    persistence, place = 0.7, RANGE_M - sigmas_inside * SIGMA_M
    belief = beliefs([False] * misses, place, miss_persistence=persistence, detection_probability=SELDOM)[-1]
    missed = missed_among_runs(float(ndtr(sigmas_inside)), misses, persistence)
    assert belief.existence[0] == pytest.approx(EXISTS * missed / (1.0 - EXISTS + EXISTS * missed), abs=0.002)


def test_what_is_at_the_edge_of_an_occluder_is_in_view_in_every_frame_or_in_none() -> None:
    """The occluder stands before it, and is seen exactly where the map has it."""
    radius, front, sharp = 0.25, 2.0, np.diag([1e-3, 1e-3]) ** 2
    half, distance = float(np.arcsin(radius / front)), 3.5
    edge = distance * np.array([np.cos(half), np.sin(half)])
    prior = MapPrior(
        (
            ObjectPrior.planar(0, *edge, sigma_m=SIGMA_M, sigma_rad=0.3, existence=EXISTS),
            ObjectPrior.planar(1, front, 0.0, sigma_m=0.01, sigma_rad=0.3),
        )
    )
    engine = Engine(configuration(max_range_m=8.0, occluder_radius_m=radius), prior)
    for k in range(8):
        shown = Detection(range_m=front, bearing_rad=0.0, covariance=sharp)
        belief = engine.process(Keyframe.planar(k, detections=[shown]))
    assert belief.existence[0] == pytest.approx(0.82, abs=0.01)


def test_what_is_seen_beyond_the_edge_weighs_each_detection_probability_as_if_it_stood_alone() -> None:
    """The least share that it is detected with is one of each probability listed, not of the one that these replace."""
    seen, at = [True, True, False, True], Detection.at(RANGE_M - 0.05, 0.0)

    def log_evidence(**open_world: Any) -> float:
        told = beliefs(seen, RANGE_M + 0.8, at=at, **open_world)
        return sum(belief.log_evidence for belief in told)

    alone = [log_evidence(detection_probability=p) for p in (0.1, 0.9)]
    together = [log_evidence(detection_probabilities=[0.1, 0.9], detection_probability=p) for p in (0.1, 0.9)]
    assert together == pytest.approx([float(np.logaddexp.reduce(alone) - np.log(2.0))] * 2, abs=1e-6)
    assert abs(alone[0] - alone[1]) > 1.0
