"""Existence of an object against closed forms, and the region in which a miss counts."""

from dataclasses import replace

import numpy as np
import pytest

from semantic_slam.configuration import OpenWorldConfiguration
from semantic_slam.inference.open_world.existence import birth, existence_after_miss, log_miss
from semantic_slam.inference.open_world.planar.detection_probability import undetected_share
from semantic_slam.inference.open_world.planar.region import SensorRegion
from semantic_slam.inference.states.detection_rates import DetectionRates

REGION = SensorRegion(min_range_m=0.5, max_range_m=5.0, field_of_view_rad=1.4, occluder_radius_m=0.2)
EXACT = np.zeros((2, 2))


def test_misses_follow_bayes_rule_in_closed_form() -> None:
    """After n misses r_n = r (1 - p)^n / (1 - r + r (1 - p)^n); the factors multiply to its denominator."""
    r, p, total = np.array([0.3, 0.9, 1.0]), np.array([0.8, 0.5, 0.2]), np.zeros(3)
    after = r
    for n in range(1, 8):
        total += log_miss(after, p)
        after = existence_after_miss(after, p)
        unseen = r * (1.0 - p) ** n
        np.testing.assert_allclose(after, unseen / (1.0 - r + unseen), rtol=1e-12)
        np.testing.assert_allclose(np.exp(total), 1.0 - r + unseen, rtol=1e-12)


def test_an_object_that_would_surely_be_seen_does_not_exist() -> None:
    existence, detected = np.array([1.0, 0.4]), np.array([1.0, 1.0])
    factor = log_miss(existence, detected)
    assert factor[0] < -600.0
    np.testing.assert_allclose(factor[1], np.log(0.6))
    assert existence_after_miss(existence, detected).tolist() == [0.0, 0.0]


def test_a_first_detection_shares_between_clutter_and_new_objects() -> None:
    intensity, existence = birth(0.9 * np.array([0.1, 0.0]), clutter=0.03)
    np.testing.assert_allclose(intensity, [0.12, 0.03])
    np.testing.assert_allclose(existence, [0.75, 0.0])
    assert birth(np.zeros(1), 0.0)[1][0] == 0.0


@pytest.mark.parametrize(
    ("position", "inside"),
    [
        ((2.0, 0.0), 1.0),
        ((0.3, 0.0), 0.0),
        ((5.5, 0.0), 0.0),
        ((2.0, 2.0), 0.0),
        ((-2.0, 0.0), 0.0),
        ((2.0, -1.5), 1.0),
    ],
)
def test_the_region_is_a_sector(position: tuple[float, float], inside: float) -> None:
    assert REGION.contains(np.array(position), EXACT) == pytest.approx(inside, abs=1e-9)


@pytest.mark.parametrize("direction", [np.pi / 2, np.pi, -3.0])
def test_the_region_turns_with_its_direction(direction: float) -> None:
    turned = replace(REGION, direction_rad=direction)
    rng = np.random.default_rng(0)
    ranges, bearings = rng.uniform(0.1, 6.0, 200), rng.uniform(-np.pi, np.pi, 200)
    places, moved = (
        np.stack([ranges * np.cos(b), ranges * np.sin(b)], axis=1) for b in (bearings, bearings + direction)
    )
    spread = np.broadcast_to(np.diag([0.01, 0.01]), (200, 2, 2))
    np.testing.assert_allclose(turned.contains(moved, spread), REGION.contains(places, spread), atol=1e-12)
    wrapped = np.arctan2(moved[:, 1], moved[:, 0])
    assert turned.holds(ranges, wrapped).tolist() == REGION.holds(ranges, bearings).tolist()
    assert 0 < REGION.holds(ranges, bearings).sum() < 200


def test_where_the_sensor_has_looked_follows_its_direction() -> None:
    behind = replace(REGION, direction_rad=np.pi)
    points = np.array([[2.0, 0.0], [-2.0, 0.0]])
    for region, expected in ((REGION, [0.01, 1.0]), (behind, [1.0, 0.01])):
        rates = DetectionRates.of(OpenWorldConfiguration(detection_probability=0.9))
        np.testing.assert_allclose(undetected_share(region, rates, np.zeros((2, 3)), points)[:, 0], expected)


def test_the_edges_of_the_region_are_as_soft_as_the_pose_is_uncertain() -> None:
    spread = np.diag([0.04, 0.04])
    assert REGION.contains(np.array([5.0, 0.0]), spread) == pytest.approx(0.5, abs=1e-6)
    assert REGION.contains(np.array([5.2, 0.0]), spread) == pytest.approx(0.15866, abs=1e-4)  # one sigma outside
    edge = 3.0 * np.array([np.cos(0.7), np.sin(0.7)])
    assert REGION.contains(edge, spread) == pytest.approx(0.5, abs=1e-6)


def test_all_round_there_is_no_edge_behind() -> None:
    region = SensorRegion(min_range_m=0.0, max_range_m=5.0, field_of_view_rad=2.0 * np.pi)
    assert region.contains(np.array([-2.0, 0.0]), np.eye(2) * 0.01) == pytest.approx(1.0)
    assert region.area_m2 == pytest.approx(np.pi * 25.0)


def test_what_stands_in_front_hides_what_is_behind_it() -> None:
    ranges, bearings = np.array([2.0, np.nan]), np.array([0.0, 0.5])
    positions = np.array([[4.0, 0.1], [1.0, 0.0], [4.0, 1.0], [-4.0, 0.0], [2.1, 0.0]])
    np.testing.assert_array_equal(REGION.not_occluded(positions, ranges, bearings), [0.0, 1.0, 1.0, 1.0, 1.0])


def test_what_may_stand_in_front_hides_as_probably_as_it_does_so() -> None:
    random, count = np.random.default_rng(5), 200_000
    sigmas, front, place = np.array([0.15, 0.06]), (2.0, 0.05), np.array([2.7, 0.2])
    variances = sigmas[None] ** 2
    told = REGION.not_occluded(place, np.array(front[:1]), np.array(front[1:]), variances=variances)
    distance = np.hypot(*place) + sigmas[0] * random.normal(size=count)
    bearing = np.arctan2(*place[::-1]) + sigmas[1] * random.normal(size=count)
    drawn = np.stack([distance * np.cos(bearing), distance * np.sin(bearing)], axis=1)
    expected = REGION.not_occluded(drawn, np.array(front[:1]), np.array(front[1:])).mean()
    assert 0.1 < told < 0.9 and told == pytest.approx(expected, abs=0.005)


def test_the_area_is_that_of_the_sector() -> None:
    random = np.random.default_rng(0)
    points = random.uniform(-5.0, 5.0, size=(200_000, 2))
    share = REGION.contains(points, np.zeros((len(points), 2, 2))).mean()
    assert share * 100.0 == pytest.approx(REGION.area_m2, rel=0.03)


def test_what_stood_behind_a_known_object_was_not_looked_at() -> None:
    region, trail = replace(REGION, occluder_radius_m=0.25), np.zeros((3, 3))
    rates = DetectionRates.of(OpenWorldConfiguration(detection_probability=0.9))
    points, before = np.array([[4.0, 0.0], [4.0, 1.0]]), np.array([[2.0, 0.1]])

    def left(*hiding: np.ndarray) -> np.ndarray:
        return undetected_share(region, rates, trail, points, *hiding)[:, 0]

    np.testing.assert_allclose(left(before), [1.0, 0.1**3])
    np.testing.assert_allclose(left(2.5 * before), [0.1**3, 0.1**3])
    np.testing.assert_allclose(left(), [0.1**3, 0.1**3])
