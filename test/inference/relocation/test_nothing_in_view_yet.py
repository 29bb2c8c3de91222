"""Where the region of the sensor is learned, nothing is in view before the first detection, and nothing is missed."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from semantic_slam import Engine, MapPrior, ObjectPrior
from semantic_slam.configuration import OpenWorldConfiguration, load_configuration
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.models.sensed_region import SensedRegion
from semantic_slam.inference.open_world.planar.region import region_of, sensor_region
from semantic_slam.shipped import configuration_file

AHEAD = [[6.5, 0.5], [6.8, -0.7], [7.5, 0.3], [7.0, 1.2], [8.0, -1.0], [7.3, -0.2]]
LEFT = [[6.0 + 0.9 * i, 3.0 + 0.4 * (i % 2)] for i in range(8)]
STEP_M, REACH_M, HALF_ANGLE_RAD, NUM_KEYFRAMES, LONG_BEFORE_ANY = 0.25, 4.5, 0.5, 30, 17
TO_BE_LEARNED = OpenWorldConfiguration(learn_region=True)


def looking_left() -> list[Keyframe]:
    """A robot that drives straight on, past what is ahead, and sees only what lies to its left."""
    random, keyframes = np.random.default_rng(0), []
    for k in range(NUM_KEYFRAMES):
        offsets = np.array(LEFT) - [STEP_M * k, 0.0]
        ranges, bearings = np.hypot(*offsets.T), np.arctan2(offsets[:, 1], offsets[:, 0])
        seen = (ranges < REACH_M) & (np.abs(bearings - 0.5 * np.pi) < HALF_ANGLE_RAD)
        detections = [
            Detection(
                range_m=r + 0.03 * random.normal(),
                bearing_rad=b + 0.01 * random.normal(),
                covariance=np.diag([0.05, 0.02]) ** 2,
            )
            for r, b in zip(ranges[seen].tolist(), bearings[seen].tolist(), strict=True)
        ]
        motion = (STEP_M if k else 0.0, 0.0, 0.0)
        keyframes.append(Keyframe.planar(k, motion=motion, motion_sigmas=(0.02, 0.01, 0.01), detections=detections))
    return keyframes


@cache
def second_session() -> tuple[Engine, list[HybridBelief]]:
    """The shipped configuration for a second session, whose robot knows where it starts."""
    settings = load_configuration(configuration_file("detector_second_session"))
    settings = replace(settings, semantic_model=replace(settings.semantic_model, kind="none"))
    known = MapPrior(
        tuple(ObjectPrior.planar(n, x, y, sigma_m=0.05, sigma_rad=3.0) for n, (x, y) in enumerate([*AHEAD, *LEFT]))
    )
    engine = Engine(settings, known, initial_covariance=np.diag([0.05, 0.05, 0.02]) ** 2)
    return engine, [engine.process(keyframe) for keyframe in looking_left()]


@pytest.mark.long
def test_nobody_is_taken_for_carried_because_a_camera_that_looks_aside_has_seen_nothing_yet() -> None:
    engine, _ = second_session()
    assert engine.carried_spans.spans == ()


@pytest.mark.long
def test_objects_that_nobody_has_looked_at_are_not_missed() -> None:
    _, beliefs = second_session()
    first = beliefs[0].existence[: len(AHEAD)]
    assert not any(len(belief.detection_ids) for belief in beliefs[:LONG_BEFORE_ANY])
    np.testing.assert_allclose(beliefs[LONG_BEFORE_ANY].existence[: len(AHEAD)], first, atol=1e-9)
    assert (beliefs[-1].existence[: len(AHEAD)] > 0.8).all()


def test_a_region_to_be_learned_holds_nothing_until_something_is_detected() -> None:
    places, covariance = np.array([[2.0, 0.1], [0.5, 0.5], [-1.0, 0.0]]), np.eye(2)
    region = sensor_region(TO_BE_LEARNED)
    assert not region.contains(places, covariance).any() and region.farthest_m == 0.0
    sensed = SensedRegion.of(np.array([np.nan]), np.array([0.1]))
    by_bearing = region.reaching(sensed)
    assert by_bearing.contains(places, covariance)[0] > 0.2
    assert (by_bearing.min_range_m, by_bearing.max_range_m) == (TO_BE_LEARNED.min_range_m, TO_BE_LEARNED.max_range_m)


def test_what_a_run_has_learned_is_known_and_what_is_stated_always_is() -> None:
    sensed = SensedRegion.of(np.array([2.0]), np.array([0.1]))
    assert sensed is not None and region_of(TO_BE_LEARNED, sensed.named()).is_known
    assert not region_of(TO_BE_LEARNED, {}).is_known
    assert region_of(OpenWorldConfiguration(), {}).is_known
