"""Whether a detection is of a known object or of a new one, at the edge of the region: uncertain robots and maps."""

import numpy as np
import pytest

from semantic_slam import Configuration, Detection, Engine, Keyframe
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior

NEAREST_M, FARTHEST_M, VIEW_RAD = 0.3, 5.0, 1.6
DETECTED, CLUTTER, BIRTHS, EXISTS = 0.9, 0.3, 0.1, 0.8
SIGMA_RANGE, SIGMA_BEARING, SIGMA_HEADING, SIGMA_OBJECT = 0.1, 0.03, 0.05, 0.05
COUNT = 200_000
Pair = tuple[float, float]


def log_ratio(sigma_m: float, place: Pair, seen: Pair, sigma_object: float = SIGMA_OBJECT, misses: int = 0) -> float:
    """Log ratio of the weights of the hypotheses that the detection is of the map's object, and of a new one.

    The robot is at rest, and sees nothing in ``misses`` keyframes before.
    """
    region = {"min_range_m": NEAREST_M, "max_range_m": FARTHEST_M, "field_of_view_rad": VIEW_RAD}
    rates = {"detection_probability": DETECTED, "clutter_per_frame": CLUTTER, "birth_density": BIRTHS}
    plain = {"occluder_radius_m": 0.0, "merge_position_m": 0.0, "gate_sigma": 8.0}
    plain |= {"least_undetected_share": 1.0}
    configuration = Configuration.of(
        association="open",
        semantic_model={"kind": "none"},
        open_world=region | rates | plain,
        pruning={"ratio": 1e12},
    )
    known = ObjectPrior.planar(0, *place, 0.0, sigma_m=sigma_object, sigma_rad=0.3, existence=EXISTS)
    engine = Engine(
        configuration, MapPrior((known,)), initial_covariance=np.diag([sigma_m, sigma_m, SIGMA_HEADING]) ** 2
    )
    detection = Detection(range_m=seen[0], bearing_rad=seen[1], covariance=np.diag([SIGMA_RANGE, SIGMA_BEARING]) ** 2)
    for keyframe in range(misses):
        engine.process(Keyframe.planar(keyframe, motion_sigmas=(1e-4,) * 3))
    belief = engine.process(Keyframe.planar(misses, detections=[detection], motion_sigmas=(1e-4,) * 3))
    weights = {own.associations: own.weight for own in belief.hypotheses}
    known = weights.pop((0,))
    return float(np.log(known / sum(weights.values())))


def drawn_log_ratio(
    sigma_m: float, place: Pair, seen: Pair, sigma_object: float = SIGMA_OBJECT, misses: int = 0
) -> float:
    """That ratio by draws of the robot and the object, and of what was measured."""
    random, variance = np.random.default_rng(0), sigma_m**2 + sigma_object**2
    heading = SIGMA_HEADING * random.normal(size=COUNT)
    apart = np.array(place) + np.sqrt(variance) * random.normal(size=(COUNT, 2))
    in_region = _detected(np.hypot(*apart.T), np.arctan2(apart[:, 1], apart[:, 0]) - heading)
    ranges = seen[0] + SIGMA_RANGE * random.normal(size=COUNT)
    bearings = seen[1] + SIGMA_BEARING * random.normal(size=COUNT)
    turns = bearings + heading
    away = (ranges * np.cos(turns) - place[0]) ** 2 + (ranges * np.sin(turns) - place[1]) ** 2
    density = ranges * np.exp(-0.5 * away / variance) / (2.0 * np.pi * variance)
    in_view = _detected(ranges, bearings)
    known = EXISTS * (in_view * (1.0 - in_view) ** misses * density).mean()
    area = 0.5 * VIEW_RAD * (FARTHEST_M**2 - NEAREST_M**2)
    new = (BIRTHS * DETECTED + CLUTTER / area) * seen[0]
    new *= 1.0 - EXISTS + EXISTS * ((1.0 - in_region) ** (misses + 1)).mean()
    return float(np.log(known) - np.log(new))


def _detected(ranges: np.ndarray, bearings: np.ndarray) -> np.ndarray:
    inside = (ranges > NEAREST_M) & (ranges < FARTHEST_M) & (np.abs(bearings) < 0.5 * VIEW_RAD)
    return DETECTED * inside


@pytest.mark.parametrize(
    ("sigma_m", "place", "seen"),
    [
        (0.3, (5.5, 0.0), (4.5, 0.1)),
        (1.0, (5.5, 0.0), (4.5, 0.1)),
        (1.0, (7.0, 0.0), (4.0, 0.0)),
        (1.0, (2.5, 2.5), (3.0, 0.4)),
        (1.0, (1.0, 0.0), (1.5, 0.0)),
        (2.5, (2.5, 2.5), (3.0, 0.4)),
    ],
)
def test_a_known_object_against_a_new_one_weighs_as_the_integral_over_the_robot(
    sigma_m: float, place: Pair, seen: Pair
) -> None:
    assert log_ratio(sigma_m, place, seen) == pytest.approx(drawn_log_ratio(sigma_m, place, seen), abs=0.2)


@pytest.mark.parametrize("misses", [0, 1])
@pytest.mark.parametrize(
    ("sigma_object", "place", "seen"),
    [
        (0.1, (2.5, 0.0), (2.7, 0.1)),
        (0.1, (5.0, 0.0), (4.9, 0.0)),
        (0.5, (5.0, 0.0), (4.5, 0.1)),
        (0.5, (2.0, 2.5), (3.0, 0.75)),
        (1.0, (7.0, 0.0), (4.0, 0.0)),
        (1.0, (1.0, 3.0), (3.0, 0.6)),
        (1.5, (5.5, 0.0), (4.5, 0.1)),
        (1.5, (-0.5, 0.0), (0.8, 0.0)),
    ],
)
def test_an_object_of_which_the_map_is_not_sure_weighs_as_the_integral_over_its_place(
    sigma_object: float, place: Pair, seen: Pair, misses: int
) -> None:
    """Expected inside, at an edge or outside of the region; without history, or after a miss of a robot at rest."""
    exact = drawn_log_ratio(1e-3, place, seen, sigma_object, misses)
    assert log_ratio(1e-3, place, seen, sigma_object, misses) == pytest.approx(exact, abs=0.2)
