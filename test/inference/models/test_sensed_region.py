"""How far a sensor sees, from what it has detected: integrals over all regions that may have shown as much."""

import numpy as np
import pytest
from scipy.integrate import quad

from semantic_slam.configuration import OpenWorldConfiguration
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.sensed_region import (
    LEAST_WIDTH_RAD,
    MARGIN_RAD,
    MOST_WIDTH_RAD,
    RANGE_MARGIN,
    SensedRegion,
)
from semantic_slam.inference.open_world.planar.region import sensor_region


def region_of(ranges_m: list[float] | Array, bearings_rad: list[float] | Array) -> SensedRegion:
    found = SensedRegion.of(np.array(ranges_m), np.array(bearings_rad))
    assert found is not None
    return found


@pytest.mark.parametrize("bearings", [[0.3], [0.3, 0.35], [-0.4, 0.1, 0.5], [-0.9, -0.2, 0.1, 0.4, 1.0]])
def test_the_width_is_that_of_the_density_expected_in_it(bearings: list[float]) -> None:
    spread, count = max(bearings) - min(bearings), len(bearings)
    least = max(spread, LEAST_WIDTH_RAD)

    def posterior(width: float) -> float:
        """Even in the logarithm before; the middle is anywhere that has all detections inside."""
        return (width - spread) / width * width ** -(count - 1.0) / width

    total = quad(posterior, least, MOST_WIDTH_RAD)[0]
    expected = quad(lambda width: posterior(width) / width, least, MOST_WIDTH_RAD)[0] / total
    width = region_of([2.0] * count, bearings).field_of_view_rad
    assert width == pytest.approx(max(1.0 / expected, spread + 2.0 * MARGIN_RAD), rel=1e-6)


@pytest.mark.parametrize("count", [1, 2, 4])
def test_the_range_is_that_of_the_density_expected_in_it(count: int) -> None:
    total = quad(lambda r: r ** -(2.0 * count + 1.0), 3.0, np.inf)[0]
    expected = quad(lambda r: r ** -(2.0 * count + 3.0), 3.0, np.inf)[0] / total
    own = region_of(np.linspace(3.0, 1.0, count), np.zeros(count))
    assert own.max_range_m == pytest.approx(expected**-0.5, rel=1e-6)


def test_many_detections_leave_their_bounds_with_margins() -> None:
    random = np.random.default_rng(0)
    ranges = np.sqrt(random.uniform(1.0, 16.0, size=2000))
    own = region_of(ranges, random.uniform(-1.2, 0.4, size=2000))
    assert own.max_range_m == pytest.approx(4.0 * RANGE_MARGIN, rel=0.01)
    assert own.min_range_m == pytest.approx(1.0 / RANGE_MARGIN, rel=0.02)
    assert own.field_of_view_rad == pytest.approx(1.6 + 2.0 * MARGIN_RAD, rel=0.01)
    assert own.direction_rad == pytest.approx(-0.4, abs=0.01)


def test_one_detection_tells_little_of_what_lies_aside() -> None:
    own = region_of([3.0], [0.2])
    assert own.field_of_view_rad == pytest.approx(1.0 / 0.727, rel=0.01)
    assert own.max_range_m == pytest.approx(np.sqrt(2.0) * 3.0)
    assert own.min_range_m == 0.0


def test_what_all_regions_hold_on_average_is_a_region_s_density() -> None:
    """Of regions drawn from the prior: E[1 / W] given what was drawn in them, whatever the number."""
    random = np.random.default_rng(1)
    errors = []
    for _ in range(4000):
        width = LEAST_WIDTH_RAD * np.exp(random.uniform(0.0, np.log(MOST_WIDTH_RAD / LEAST_WIDTH_RAD)))
        drawn = width * random.uniform(-0.5, 0.5, size=3)
        errors.append(1.0 / region_of(np.full(3, 2.0), drawn).field_of_view_rad - 1.0 / width)
    assert np.mean(errors) == pytest.approx(0.0, abs=0.02)


def test_detections_are_taken_in_keyframe_by_keyframe() -> None:
    ranges, bearings = np.array([2.0, np.nan, 3.5, 1.2]), np.array([0.1, 0.6, -0.2, 0.4])
    first = SensedRegion.of(ranges[:2], bearings[:2])
    assert SensedRegion.of(ranges[2:], bearings[2:], first) == SensedRegion.of(ranges, bearings)


def test_bearings_alone_show_the_sides_of_a_region_and_leave_its_ranges_as_stated() -> None:
    bearings = np.random.default_rng(2).uniform(-1.2, 0.4, size=500)
    own, stated = region_of(np.full(500, np.nan), bearings), sensor_region(OpenWorldConfiguration())
    found = stated.reaching(own)
    assert own.named().keys() == {"open_world.field_of_view_rad", "open_world.direction_rad"}
    assert (found.min_range_m, found.max_range_m) == (stated.min_range_m, stated.max_range_m)
    assert found.field_of_view_rad == pytest.approx(1.6 + 2.0 * MARGIN_RAD, rel=0.02)
    assert SensedRegion.of(np.zeros(0), np.zeros(0)) is None


def test_a_first_range_after_bearings_bounds_the_ranges() -> None:
    bearing = region_of([np.nan], [0.3])
    later = SensedRegion.of(np.array([2.5]), np.array([0.1]), bearing)
    assert later is not None
    assert (later.nearest_m, later.farthest_m, later.num_ranges, later.num_bearings) == (2.5, 2.5, 1, 2)


@pytest.mark.parametrize("spread", [0.6, 0.9, 1.6])
def test_a_region_is_settled_once_it_is_expected_to_end_within_its_margins(spread: float) -> None:
    """Without the bound of a whole turn, n detections let expect (n + 1) / (n - 1) of the width that they span."""
    settled = int(np.ceil(1.0 + spread / MARGIN_RAD - 1e-9))
    found = [region_of(np.full(n, 3.0), np.linspace(0.0, spread, n)).is_settled for n in range(5, 40)]
    assert found == [n >= settled for n in range(5, 40)]


def test_narrow_and_whole_regions_are_settled_by_their_ranges() -> None:
    for spread in (0.0, 2.0 * np.pi - 1e-6):
        found = [region_of(np.full(n, 3.0), np.linspace(0.0, spread, n)).is_settled for n in (4, 5, 40)]
        assert found[::2] == [False, True]
    assert region_of(np.full(40, np.nan), np.linspace(0.0, 1.0, 40)).is_settled


def test_a_region_is_not_learned_beyond_the_range_up_to_which_detections_are_used() -> None:
    ranges, bearings = np.array([2.0, 4.8]), np.zeros(2)
    own = SensedRegion.of(ranges[1:], bearings[1:], SensedRegion.of(ranges[:1], bearings[:1], most_m=5.0))
    assert own is not None and own.max_range_m == 5.0
    assert region_of(ranges, bearings).max_range_m == pytest.approx(4.8 * np.sqrt(1.5))


def test_a_sensor_that_looks_all_around_has_no_sides() -> None:
    own = region_of(np.full(40, 5.0), np.linspace(-3.1, 3.1, 40))
    assert own.field_of_view_rad == pytest.approx(2.0 * np.pi)
