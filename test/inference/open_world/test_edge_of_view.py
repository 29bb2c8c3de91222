"""A robot at rest sees an object at the edge of its view in every frame or in none, by integrals over its place."""

from typing import Any

import numpy as np
import pytest
from scipy.special import ndtr

from semantic_slam import Configuration, Detection, Engine, Keyframe
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior

HIT, EXISTS, RANGE_M, SIGMA_M = 0.9, 0.9, 4.0, 0.2
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


def beliefs(
    seen: list[bool], x_m: float, step_m: float = 0.0, at: Detection | None = None, **open_world: Any
) -> list[HybridBelief]:
    """Of a robot that knows where it is, and an object at ``x_m`` of which the map is not sure."""
    settings = Configuration.of(
        association="open",
        semantic_model={"kind": "none"},
        initial_pose={"sigma": [1e-4, 1e-4, 1e-5]},
        odometry=STILL,
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
    prior = MapPrior((ObjectPrior.planar(0, x_m, 0.0, sigma_m=SIGMA_M, sigma_rad=0.3, existence=EXISTS),))
    engine, found = Engine(settings, prior), list[HybridBelief]()
    for k, is_seen in enumerate(seen):
        detections = [at or Detection.at(x_m, 0.0)] if is_seen else []
        found.append(engine.process(Keyframe.planar(k, detections=detections, motion=(k and step_m, 0.0, 0.0))))
    return found


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
