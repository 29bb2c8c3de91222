"""Account of a stretch of a drive: births, later detections and misses of objects that may be false alarms."""

import numpy as np
import pytest

from semantic_slam.configuration import OpenWorldConfiguration
from semantic_slam.inference.open_world.planar.region import sensor_region
from semantic_slam.inference.reassociation.accounts import StretchAccount
from semantic_slam.inference.states.detection_rates import DetectionRates

DETECTED, DENSITY, CLUTTER = 0.7, 0.05, 0.4
WORLD = OpenWorldConfiguration(
    detection_probability=DETECTED,
    clutter_per_frame=CLUTTER,
    birth_density=DENSITY,
    min_range_m=0.1,
    max_range_m=6.0,
    field_of_view_rad=2.0,
)
REGION = sensor_region(WORLD)
BEGIN = 2
AHEAD = np.array([2.0, 0.0])
"""A place in the middle of what a robot at the origin sees."""


def account(seen: list[int], *, keyframes: int) -> StretchAccount:
    """A robot that looks away from ``AHEAD`` until the stretch begins, and then at it; one object there."""
    path = np.zeros((keyframes, 3))
    path[:BEGIN, 2] = np.pi
    times = np.zeros((min(len(seen), 1), keyframes), dtype=bool)
    times[:, seen] = True
    return StretchAccount(
        settings=WORLD,
        rates=DetectionRates.of(WORLD),
        region=REGION,
        path=path,
        begin=BEGIN,
        ids=np.arange(len(times)),
        places=np.tile(AHEAD, (len(times), 1)),
        seen=times,
    )


@pytest.mark.parametrize("missed", [0, 1, 2, 5])
def test_an_object_that_was_seen_once_is_a_first_detection_that_then_was_missed_or_a_false_alarm(missed: int) -> None:
    keyframes = BEGIN + 1 + missed
    once, nothing = account([BEGIN], keyframes=keyframes), account([], keyframes=keyframes)
    real, false = DENSITY * DETECTED * (1.0 - DETECTED) ** missed, CLUTTER / REGION.area_m2
    assert (once.log_likelihoods - nothing.log_likelihoods)[0] == pytest.approx(np.log(real + false), abs=1e-5)
    assert once.existence[0, 0] == pytest.approx(real / (real + false), abs=1e-5)


def test_an_object_that_was_seen_again_is_no_false_alarm() -> None:
    twice, nothing = account([BEGIN, BEGIN + 3], keyframes=BEGIN + 4), account([], keyframes=BEGIN + 4)
    expected = np.log(DENSITY * DETECTED**2 * (1.0 - DETECTED) ** 2)
    assert (twice.log_likelihoods - nothing.log_likelihoods)[0] == pytest.approx(expected, abs=1e-5)
    assert twice.existence[0, 0] == 1.0


def test_an_object_of_before_counts_by_what_it_was_known_by() -> None:
    once, twice = account([0], keyframes=BEGIN + 2), account([0, 1], keyframes=BEGIN + 2)
    real, false = DENSITY * DETECTED, CLUTTER / REGION.area_m2
    there, missed = real / (real + false), (1.0 - DETECTED) ** 2
    assert once.by_object[0, 0] == pytest.approx(np.log(there * missed + 1.0 - there), abs=1e-5)
    assert twice.by_object[0, 0] == pytest.approx(np.log(missed), abs=1e-5)
