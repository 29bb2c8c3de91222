"""First detections expected over the region where detection falls off with distance: against closed forms and draws."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import qmc

from semantic_slam.configuration import OpenWorldConfiguration
from semantic_slam.inference.open_world.planar.detection_probability import undetected_share
from semantic_slam.inference.open_world.planar.region import SensorRegion
from semantic_slam.inference.open_world.planar.unseen_ground import first_detections
from semantic_slam.inference.open_world.rings import rings
from semantic_slam.inference.states.detection_rates import DetectionRates

NEAREST_M, FARTHEST_M, DENSITY, DETECTED = 0.3, 30.0, 0.01, 0.9
SHARES = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
"""Half ranges as shares of the farthest distance."""
LEAST = 0.02
NOWHERE = np.zeros((0, 3))


def rates(*half_ranges_m: float) -> DetectionRates:
    return DetectionRates.of(
        OpenWorldConfiguration(
            detection_half_ranges_m=half_ranges_m, birth_density=DENSITY, detection_probability=DETECTED
        )
    )


def region(axis_rad: float | None = None) -> SensorRegion:
    return SensorRegion(
        min_range_m=NEAREST_M, max_range_m=FARTHEST_M, field_of_view_rad=1.6, direction_rad=0.2, axis_rad=axis_rad
    )


def expected(of: SensorRegion, sensor: DetectionRates, trail: np.ndarray) -> np.ndarray:
    robot, nothing = np.array([1.0, -2.0, 0.4]), np.zeros((0, 2))
    return first_detections(of, sensor, trail, robot, nothing, LEAST)[0]


def alone(half_range_m: float) -> float:
    """Integral over the sector of the half-normal fall-off, in the plane."""
    mean = half_range_m**2 / np.log(2.0) / 2.0
    inner, outer = (0.5 ** (bound / half_range_m) ** 2 for bound in (NEAREST_M, FARTHEST_M))
    return float(DENSITY * DETECTED * 1.6 * mean * (inner - outer))


@pytest.mark.parametrize("share", SHARES)
def test_the_near_field_of_a_long_range_is_not_missed(share: float) -> None:
    half_range = share * FARTHEST_M
    assert expected(region(), rates(half_range), NOWHERE) == pytest.approx(alone(half_range), rel=0.005)


def test_each_of_several_half_ranges_has_its_own_integral() -> None:
    half_ranges = [share * FARTHEST_M for share in SHARES]
    told = expected(region(), rates(*half_ranges), NOWHERE)
    np.testing.assert_allclose(told, [alone(own) for own in half_ranges], rtol=0.005)


@pytest.mark.parametrize("share", SHARES)
def test_where_ranges_are_depths_the_fall_off_is_still_one_of_distance(share: float) -> None:
    of, half_range = region(axis_rad=-0.1), share * FARTHEST_M
    total = 0.0
    for off in 0.3 + 1.6 * ((np.arange(2000) + 0.5) / 2000 - 0.5):
        bounds = np.array([NEAREST_M, FARTHEST_M]) / np.cos(off)
        inner, outer = 0.5 ** (bounds / half_range) ** 2
        total += half_range**2 / np.log(2.0) / 2.0 * (inner - outer) * 1.6 / 2000
    assert expected(of, rates(half_range), NOWHERE) == pytest.approx(DENSITY * DETECTED * total, rel=0.1)


@pytest.mark.parametrize("share", SHARES)
def test_what_was_looked_at_before_is_less_likely_seen_first_now(share: float) -> None:
    """Against 8000 points, denser near the robot, of a robot that comes near by steps of a metre, turning."""
    of, sensor, robot = region(), rates(share * FARTHEST_M), np.array([1.0, -2.0, 0.4])
    steps = np.arange(-4.0, 0.0)[:, None]
    trail = robot + steps * np.array([np.cos(0.4), np.sin(0.4), 0.1])
    draws = qmc.Sobol(2, seed=0).random(8192)
    ranges = NEAREST_M + (FARTHEST_M - NEAREST_M) * draws[:, 0] ** 3
    turns = robot[2] + 0.2 + 1.6 * (draws[:, 1] - 0.5)
    points = robot[:2] + ranges[:, None] * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    density = 3.0 * (FARTHEST_M - NEAREST_M) * draws[:, 0] ** 2 * ranges * 1.6
    left = np.maximum(undetected_share(of, sensor, trail, points), LEAST) * sensor.fall_off(ranges)
    exact = DENSITY * DETECTED * (density[:, None] * left).mean(axis=0)
    assert expected(of, sensor, trail) == pytest.approx(exact, rel=0.25)


@pytest.mark.parametrize("share", SHARES)
def test_shells_in_space_sum_to_the_integral(share: float) -> None:
    half_range = share * FARTHEST_M
    found = rings(NEAREST_M, FARTHEST_M, (half_range, np.inf), 3)
    volume = (FARTHEST_M**3 - NEAREST_M**3) / 3.0
    near = quad(lambda r: r * r * 0.5 ** (r / half_range) ** 2, NEAREST_M, FARTHEST_M, points=[3.0 * half_range])[0]
    np.testing.assert_allclose(found.shares @ found.fall_off, [near / volume, 1.0], rtol=0.01)
    assert (np.diff(found.ranges_m) > 0.0).all()


def test_without_fall_off_rings_are_of_equal_area() -> None:
    found = rings(0.0, 2.0, (np.inf,), 2)
    np.testing.assert_allclose(found.ranges_m**2, [0.5, 1.5, 2.5, 3.5])
    assert (found.shares == 0.25).all() and (found.fall_off == 1.0).all()
