"""Whether a detection in space is of an object of which the map is not sure, or of a new one: by an integral."""

import numpy as np
import pytest

from semantic_slam import Configuration, Detection, Engine, Keyframe
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior

NEAREST_M, FARTHEST_M, HALF_WIDTH_RAD, HALF_HEIGHT_RAD = 0.3, 5.0, 0.8, 0.6
DETECTED, CLUTTER, BIRTHS, EXISTS = 0.9, 0.3, 0.1, 0.8
SIGMA_RANGE, SIGMA_RAY = 0.1, 0.02
ORIGIN = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
VOLUME = 4.0 * np.arcsin(np.sin(HALF_WIDTH_RAD) * np.sin(HALF_HEIGHT_RAD)) * (FARTHEST_M**3 - NEAREST_M**3) / 3.0
COUNT = 100_000
Place = tuple[float, float, float]


def log_ratio(sigma_m: float, place: Place, seen: Place) -> float:
    """Log ratio of the weights of the hypotheses that the detection is of the map's object, and of a new one."""
    region = {"min_range_m": NEAREST_M, "max_range_m": FARTHEST_M, "field_of_view_rad": 2.0 * HALF_WIDTH_RAD}
    region |= {"vertical_field_of_view_rad": 2.0 * HALF_HEIGHT_RAD, "occluder_radius_m": 0.0}
    rates = {"detection_probability": DETECTED, "clutter_per_frame": CLUTTER, "birth_density": BIRTHS}
    configuration = Configuration.of(
        state_space="spatial",
        observation="points",
        association="open",
        semantic_model={"kind": "none"},
        open_world=region | rates | {"merge_position_m": 0.0, "gate_sigma": 8.0},
        pruning={"ratio": 1e12},
    )
    known = ObjectPrior(
        object_id=0,
        name="0",
        class_probabilities={},
        pose=np.array([*place, 0.0, 0.0, 0.0, 1.0]),
        covariance=np.diag([sigma_m] * 3 + [0.3] * 3) ** 2,
        existence=EXISTS,
    )
    engine = Engine(configuration, MapPrior((known,)), initial_pose=ORIGIN, initial_covariance=1e-8 * np.eye(6))
    reach = float(np.linalg.norm(seen))
    detection = Detection.along(
        np.array(seen) / reach, reach, sigma_range_m=SIGMA_RANGE, ray_covariance=SIGMA_RAY**2 * np.eye(3)
    )
    belief = engine.process(Keyframe.spatial(0, detections=[detection], motion_covariance=1e-10 * np.eye(6)))
    weights = {own.associations: own.weight for own in belief.hypotheses}
    return float(np.log(weights[(0,)] / weights[(1,)]))


def drawn_log_ratio(sigma_m: float, place: Place, seen: Place) -> float:
    """That ratio by draws of the object, and of what was measured."""
    random, reach = np.random.default_rng(0), float(np.linalg.norm(seen))
    missed = 1.0 - EXISTS * _detected(np.array(place) + sigma_m * random.normal(size=(COUNT, 3))).mean()
    rays = np.array(seen) / reach + SIGMA_RAY * random.normal(size=(COUNT, 3))
    ranges = reach + SIGMA_RANGE * random.normal(size=COUNT)
    points = (ranges / np.linalg.norm(rays, axis=1))[:, None] * rays
    away = ((points - place) ** 2).sum(axis=1) / sigma_m**2
    density = ranges**2 * np.exp(-0.5 * away) / (2.0 * np.pi * sigma_m**2) ** 1.5
    known = EXISTS * (_detected(points) * density).mean()
    return float(np.log(known) - np.log((BIRTHS * DETECTED + CLUTTER / VOLUME) * reach**2 * missed))


def _detected(points: np.ndarray) -> np.ndarray:
    """By points along the axes of the body, ahead of which the camera looks."""
    distance, (ahead, left, up) = np.linalg.norm(points, axis=1), points.T
    inside = (distance > NEAREST_M) & (distance < FARTHEST_M) & (np.abs(np.arctan2(left, ahead)) < HALF_WIDTH_RAD)
    return DETECTED * (inside & (np.abs(np.arctan2(up, ahead)) < HALF_HEIGHT_RAD))


@pytest.mark.parametrize(
    ("sigma_m", "place", "seen"),
    [
        (0.1, (3.0, 0.0, 0.0), (3.1, 0.1, 0.0)),
        (0.5, (5.0, 0.0, 0.0), (4.5, 0.3, 0.2)),
        (1.0, (7.0, 0.0, 0.0), (4.0, 0.0, 0.0)),
        (1.0, (2.0, 2.5, 0.0), (3.0, 2.0, 0.3)),
        (1.0, (2.5, 0.0, 2.5), (3.0, 0.0, 1.5)),
        (1.5, (5.5, 0.0, 0.0), (4.5, 0.1, 0.5)),
    ],
)
def test_an_object_of_which_the_map_is_not_sure_weighs_as_the_integral_over_its_place(
    sigma_m: float, place: Place, seen: Place
) -> None:
    """Expected inside, at an edge or outside of the region."""
    assert log_ratio(sigma_m, place, seen) == pytest.approx(drawn_log_ratio(sigma_m, place, seen), abs=0.2)
