"""What a sensor misses by direction: misses, births and existence count by where things are in its picture."""

import numpy as np
import pytest
from scipy.stats import qmc

from semantic_slam import Configuration, Engine, Keyframe, MapPrior
from semantic_slam.configuration import OpenWorldConfiguration
from semantic_slam.errors import InputError
from semantic_slam.inference.open_world.planar.detection_probability import undetected_share
from semantic_slam.inference.open_world.planar.region import sensor_region
from semantic_slam.inference.open_world.planar.sightings import Sightings
from semantic_slam.inference.open_world.planar.unseen_ground import first_detections
from semantic_slam.inference.states.detection_rates import DetectionRates
from semantic_slam.inference.world.map_prior import ObjectPrior

FIELD_OF_VIEW, SHARES = 2.0, (0.25, 1.0, 0.5)
"""From the right edge to the left one."""
BEARINGS = np.array([-0.8, -0.4, 0.0, 0.6])
EXPECTED = np.array([0.4, 0.7, 1.0, 0.7])
WORLD = OpenWorldConfiguration(
    field_of_view_rad=FIELD_OF_VIEW, direction_rad=0.3, detection_by_direction=SHARES, birth_density=0.1
)


def around(robot: np.ndarray, bearings: np.ndarray, ranges: np.ndarray | float) -> np.ndarray:
    """(N, 2) points at bearings off the middle of the region of a robot (3,)."""
    turns = robot[2] + WORLD.direction_rad + bearings
    return np.asarray(robot[:2] + np.stack([ranges * np.cos(turns), ranges * np.sin(turns)], axis=1))


def test_an_object_that_is_missed_where_little_is_seen_may_still_be_there() -> None:
    """Of four objects of a map with existence 1/2, none is detected in three keyframes: independent coins."""
    places = around(np.zeros(3), BEARINGS, 2.0)
    placed = [
        ObjectPrior.planar(n, *place, sigma_m=1e-4, sigma_rad=1.0, existence=0.5) for n, place in enumerate(places)
    ]
    settings = Configuration.of(
        association="open",
        semantic_model={"kind": "none"},
        open_world={
            "detection_by_direction": SHARES,
            "field_of_view_rad": FIELD_OF_VIEW,
            "direction_rad": WORLD.direction_rad,
            "least_existence": 0.0,
        },
    )
    engine = Engine(settings, MapPrior(tuple(placed)), initial_covariance=np.diag([1e-8] * 3))
    for k in range(3):
        belief = engine.process(Keyframe.planar(k, detections=[], motion_sigmas=(1e-6,) * 3))
    missed = (1.0 - 0.9 * EXPECTED) ** 3
    np.testing.assert_allclose(belief.existence, missed / (missed + 1.0), rtol=1e-4)


def test_ground_is_looked_at_as_often_as_its_direction_is_seen() -> None:
    robot = np.array([1.0, -2.0, 0.9])
    left = undetected_share(
        sensor_region(WORLD), DetectionRates.of(WORLD), np.array([robot] * 3), around(robot, BEARINGS, 2.0)
    )
    np.testing.assert_allclose(left[:, 0], (1.0 - 0.9 * EXPECTED) ** 3)


def test_first_detections_are_expected_where_the_sensor_sees() -> None:
    robot, region = np.array([1.0, -2.0, 0.9]), sensor_region(WORLD)
    draws = qmc.Sobol(2, seed=0).random_base2(12)
    bearings = FIELD_OF_VIEW * (draws[:, 1] - 0.5)
    points = around(robot, bearings, np.sqrt(region.min_range_m**2 + draws[:, 0] * (25.0 - region.min_range_m**2)))
    found = 0.1 * 0.9 * np.interp(bearings, [-1.0, 0.0, 1.0], SHARES)
    told, at_points = first_detections(region, DetectionRates.of(WORLD), np.zeros((0, 3)), robot, points, 1.0)
    np.testing.assert_allclose(at_points[:, 0], found)
    assert told == pytest.approx(region.area_m2 * found.mean(), rel=0.01)


def test_proposed_histories_are_seen_by_direction() -> None:
    robot, region = np.array([1.0, -2.0, 0.9]), sensor_region(WORLD)
    sightings = Sightings(path=robot[None], regions=[region], sensors=DetectionRates.of(WORLD).sensors[0])
    np.testing.assert_allclose(sightings.in_view(around(robot, BEARINGS, 2.0))[:, 0, 0], EXPECTED, rtol=1e-3)


@pytest.mark.parametrize("world", [{"detection_by_direction": (0.5,)}, {"detection_by_direction": (0.0, 1.0)},
                                   {"detection_by_direction": SHARES, "learn_region": True}])  # fmt: skip
def test_shares_that_say_nothing_are_refused(world: dict[str, object]) -> None:
    with pytest.raises(InputError, match="detection_by_direction"):
        Engine(Configuration.of(association="open", semantic_model={"kind": "none"}, open_world=world))
