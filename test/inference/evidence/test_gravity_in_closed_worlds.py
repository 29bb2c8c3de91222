"""Gravity where objects are on a map or named: weights of histories that differ in tilt, against plain integration."""

from functools import cache
from typing import Any

import numpy as np
import pytest
from worlds.exact.spatial_fixtures import NOTHING_LEFT_OUT, history_weights, spatial

from semantic_slam import Detection, Engine, Keyframe, MapPrior, ObjectPrior
from semantic_slam.geometry import se3, so3
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.spatial.gravity import Gravity

SHELVES = np.array([[3.0, 0.0, 0.7], [3.0, 0.0, 1.3]])
"""Two points that look alike, one below the other: which one a camera sees ahead depends on its pitch."""
START = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
SIGMAS = np.array([0.1, 0.1, 0.1, 0.02, 0.02, 0.02])
"""Standard deviations of the start, [rotation, translation]."""
MOTION = se3.exp(np.array([0.02, -0.03, 0.05, 0.1, 0.02, 0.0]))
DRIFT = np.array([0.03, 0.03, 0.03, 0.02, 0.02, 0.02])
POINT_SIGMA_M, RANGE_SIGMA_M, RAY_SIGMA = 1e-3, 0.1, 0.05
UP_SIGMA_RAD = 0.04
RAYS = np.array([[1.0, 0.02, 0.01], [1.0, -0.03, -0.03]])
RANGES_M = np.array([3.05, 2.9])
LEAN_RAD = (-0.12, 0.0, 0.05)
"""Pitch that gravity tells at the first keyframe; at the second the motion has changed it."""
SAMPLES = 1_000_000
"""So many that the logarithm of their mean is off by 0.005, its standard error, where the tilt is rarest."""
METHODS = {"importance": {}, "laplace": {"method": "laplace"}, "sampled": {"method": "sampled", "num_samples": 20_000}}


def ups(lean_rad: float) -> Array:
    """(2, 3) measured verticals at the two keyframes."""
    first = np.append(np.zeros(3), so3.exp(np.array([0.03, lean_rad, 0.0])))
    turns = np.array([first[3:], se3.compose(first, MOTION)[3:]])
    return so3.matrix(turns)[:, 2]


@cache
def drawn() -> tuple[Array, Array]:
    """Verticals (N, 2, 3) of the robot along its axes at both keyframes, and log densities (N, 2, 2) of each detection.

    The latter are by detection and point. Constants that all histories share are left out.
    """
    random = np.random.default_rng(7)
    robots = se3.retract(START, random.normal(size=(SAMPLES, 6)) * SIGMAS)
    true, logs = np.empty((SAMPLES, 2, 3)), np.empty((SAMPLES, 2, 2))
    for k in range(2):
        robots = se3.compose(robots, MOTION) if k else robots
        robots = se3.retract(robots, random.normal(size=(SAMPLES, 6)) * DRIFT)
        true[:, k] = so3.matrix(robots[:, 3:])[:, 2]
        ray = RAYS[k] / np.linalg.norm(RAYS[k])
        for n, point in enumerate(SHELVES):
            away = so3.rotated(so3.inverse(robots[:, 3:]), point - robots[:, :3])
            distance = np.linalg.norm(away, axis=1)
            off = np.arccos(np.clip(away @ ray / distance, -1.0, 1.0))
            logs[:, k, n] = -0.5 * (((distance - RANGES_M[k]) / RANGE_SIGMA_M) ** 2 + (off / RAY_SIGMA) ** 2)
    return true, logs


def integrated(measured: Array | None) -> tuple[dict[tuple, float], float]:
    """Weight of each history of two keyframes, and the log of their mean density; ``measured`` (2, 3) verticals."""
    (true, logs), log_level = drawn(), np.zeros(SAMPLES)
    for k in range(2):
        if measured is not None:
            off = np.cross(true[:, k], measured[k])
            log_level -= 0.5 * (off**2).sum(axis=1) / UP_SIGMA_RAD**2 + np.log(2.0 * np.pi * UP_SIGMA_RAD**2)
    found = {
        ((a,), (b,)): float(np.log(np.mean(np.exp(logs[:, 0, a] + logs[:, 1, b] + log_level))))
        for a in range(2)
        for b in range(2)
    }
    total = float(np.logaddexp.reduce(list(found.values())))
    return {beta: float(np.exp(log - total)) for beta, log in found.items()}, total


def engine_after(measured: Array | None, **weights: Any) -> Engine:
    points = MapPrior(tuple(ObjectPrior.point(n, place, sigma_m=POINT_SIGMA_M) for n, place in enumerate(SHELVES)))
    engine = Engine(
        spatial(association="enumerated", weights={**NOTHING_LEFT_OUT["weights"], **weights}),
        points,
        initial_pose=START,
        initial_covariance=se3.covariance_along_parent(START, np.diag(SIGMAS**2)),
    )
    for k in range(2):
        told = {} if measured is None else {"up": measured[k], "sigma_up_rad": UP_SIGMA_RAD}
        spread = {"motion_covariance": np.diag(DRIFT[se3.TO_MESSAGE] ** 2)}
        seen = Detection.along(
            RAYS[k], RANGES_M[k], sigma_range_m=RANGE_SIGMA_M, ray_covariance=RAY_SIGMA**2 * np.eye(3)
        )
        motion = MOTION if k else se3.exp(np.zeros(6))
        engine.process(Keyframe.spatial(k, motion=motion, detections=[seen], **spread, **told))
    return engine


@pytest.mark.long
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("lean_rad", LEAN_RAD)
def test_weights_of_histories_that_differ_in_tilt_are_those_by_integration(lean_rad: float, method: str) -> None:
    """And the log evidence of gravity, given the detections."""
    (expected, together), (_, alone) = integrated(ups(lean_rad)), integrated(None)
    engine, blind = (engine_after(told, **METHODS[method]) for told in (ups(lean_rad), None))
    found = history_weights(engine)
    assert {beta: found[beta] for beta in expected} == pytest.approx(expected, abs=0.01)
    assert engine.log_evidence - blind.log_evidence == pytest.approx(together - alone, abs=0.02)


def test_a_vertical_as_odometry_has_it_and_another_one_weigh_histories_differently() -> None:
    upper = [history_weights(engine_after(ups(lean_rad))).get(((1,), (1,)), 0.0) for lean_rad in LEAN_RAD]
    assert upper[0] > 0.9 > upper[1] > 0.1 > upper[2]


def test_a_camera_that_sees_nothing_is_as_tilted_as_gravity_has_it() -> None:
    """Its weight counts the density of the measurement, where objects are named."""
    start, spread = np.append(np.zeros(3), so3.exp(np.array([0.1, 0.2, 0.3]))), np.diag(SIGMAS**2)
    evidence = []
    for told in ({}, {"up": ups(0.15)[0], "sigma_up_rad": UP_SIGMA_RAD}):
        engine = Engine(
            spatial(association="given"),
            initial_pose=start,
            initial_covariance=se3.covariance_along_parent(start, spread),
        )
        belief = engine.process(Keyframe.spatial(0, motion_covariance=1e-8 * np.eye(6), **told))
        evidence.append(engine.log_evidence)
    level = Gravity(ups(0.15)[0], UP_SIGMA_RAD**2).at_mode(start, spread)
    assert evidence[1] - evidence[0] == pytest.approx(level.log_evidence, abs=1e-4)
    np.testing.assert_allclose(se3.log(se3.between(start, belief.poses[0])), level.shift, atol=1e-4)
    chart = se3.right_jacobian(level.shift)
    found = se3.covariance_at_pose(belief.poses[0], belief.pose_covariances[0])
    np.testing.assert_allclose(found, chart @ level.covariance @ chart.T, atol=2e-4)
