"""Detections of what moves have the sensor's constant errors: against the joint Gaussian of robot, sensor and mover."""

from functools import cache

import numpy as np
import pytest

from semantic_slam import Configuration, Detection, Engine, Keyframe
from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.correlated_errors import CHANGE_OF_SENSOR
from semantic_slam.inference.reported.component_marginals import mover_marginals
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.states.lineage import MOVES
from semantic_slam.inference.world.map_prior import MapPrior, ObjectPrior

LANDMARKS, MOVER = np.array([[3.0, 1.5], [3.5, -1.0]]), np.array([2.5, 0.3])
MOTION = np.array([0.8, 0.3, 0.6])
START, STEP, MAPPED, SIGMAS = 4e-4, 4e-4, 4e-4, np.array([1e-3, 3e-4])
SENSOR = np.array([5e-3, 5e-3])
SPEED, STEADY = 4e-3, 3.0
ANYWHERE = 1e2
"""Standard deviation of the mover's first place; above, those of all else."""
PARTS = {"start": 3, "steps": 6, "map": 4, "sensor": 4, "place": 2, "velocity": 2, "driven": 2}
AT = dict(zip(PARTS, np.split(np.arange(sum(PARTS.values())), np.cumsum(list(PARTS.values()))[:-1]), strict=True))


def measured(causes: Array) -> Array:
    """(12,) range and bearing of both landmarks and the mover in two frames, less white errors."""
    robot, sensor, found = causes[AT["start"]], np.zeros(2), []
    points = [*(LANDMARKS + causes[AT["map"]].reshape(2, 2)), MOVER + causes[AT["place"]]]
    for k, step in enumerate(causes[AT["steps"]].reshape(2, 3)):
        robot = se2.compose(se2.compose(robot, MOTION if k else np.zeros(3)), se2.exp(step))
        sensor = sensor + SENSOR * causes[AT["sensor"]][2 * k : 2 * k + 2]
        points[2] = MOVER + moved(causes)[:2] if k else points[2]
        for point in points:
            d = se2.between(robot, np.array([*point, 0.0]))[:2]
            found.append(np.array([np.hypot(*d), np.arctan2(d[1], d[0])]) + sensor)
    return np.concatenate(found)


def moved(causes: Array) -> Array:
    """(2,) displacement of the mover from its expected place in the second frame."""
    drift = STEADY * -np.expm1(-1.0 / STEADY)
    return causes[AT["place"]] + drift * causes[AT["velocity"]] + causes[AT["driven"]]


@cache
def joint() -> tuple[Array, Array, Array, Array]:
    """Mean (12,) and covariance (12, 12) of measurements; (2, 12) of the mover's place with them, and its (2, 2)."""
    keeps = np.exp(-1.0 / STEADY)
    driven = SPEED * STEADY * np.sqrt(2.0 / STEADY - 2.0 * (1.0 - keeps) - (1.0 - keeps) ** 2)
    sizes = {"start": START, "steps": STEP, "map": MAPPED, "sensor": 1.0, "place": ANYWHERE, "velocity": SPEED}
    sigmas = np.concatenate([np.full(PARTS[name], (sizes | {"driven": driven})[name]) for name in PARTS])
    sigmas[AT["sensor"][2:]] = CHANGE_OF_SENSOR
    every, h = np.eye(len(sigmas)), 1e-6
    slopes = np.array([measured(h * own) - measured(-h * own) for own in every]).T / (2.0 * h)
    place = np.array([moved(own) for own in every]).T
    spread = slopes @ np.diag(sigmas**2) @ slopes.T + np.diag(np.tile(SIGMAS**2, 6))
    prior = place @ np.diag(sigmas**2)
    return measured(np.zeros(len(sigmas))), spread, prior @ slopes.T, prior @ place.T


def log_density(deviations: Array) -> float:
    return float(-0.5 * deviations @ np.linalg.solve(joint()[1], deviations))


def driven(deviations: Array) -> tuple[float, Component]:
    """The log probability of the history in which both landmarks stand and the third thing moves; its component."""
    settings = Configuration.of(
        association="open",
        semantic_model={"kind": "none"},
        detection_errors={
            "correlated_share": 1e-3,
            "sigma_range_offset_m": float(SENSOR[0]),
            "sigma_yaw_rad": float(SENSOR[1]),
        },
        open_world={
            "iterate_updates": False,
            "merge_position_m": 0.0,
            "occluder_radius_m": 0.0,
            "min_range_m": 0.0,
            "max_range_m": 30.0,
            "field_of_view_rad": 6.283185307179586,
            "gate_sigma": 1e3,
        },
        weights={"gate": 1e3},
        pruning={"ratio": 1e300},
        moving={"share": 0.5, "speeds_m_s": [SPEED], "steadiness_s": STEADY},
    )
    prior = MapPrior(
        tuple(ObjectPrior.planar(n, *at, sigma_m=MAPPED, sigma_rad=1.0) for n, at in enumerate(LANDMARKS.tolist()))
    )
    engine = Engine(settings, prior, initial_pose=np.zeros(3), initial_covariance=START**2 * np.eye(3))
    for k, frame in enumerate((joint()[0] + deviations).reshape(2, 3, 2)):
        seen = [Detection(range_m=r, bearing_rad=b, covariance=np.diag(SIGMAS**2)) for r, b in frame]
        motion = MOTION if k else np.zeros(3)
        engine.process(Keyframe.planar(k, motion=motion, motion_sigmas=(STEP,) * 3, detections=seen))
    for hypothesis, live in engine.live.items():
        first, second = live.lineage
        if second.class_assignment[2] == MOVES and first.association[:2] == second.association[:2] == (0, 1):
            return engine.log_evidence + live.log_weight, engine.pool._backends[0].held[hypothesis].component
    raise AssertionError("no history has the mover")


@cache
def as_expected() -> float:
    """The log probability of that history if all measurements are what they are expected to be."""
    return driven(np.zeros(12))[0]


def drawn(seed: int) -> Array:
    """(12,) deviations of the measurements; of the first detection of the mover none."""
    spread = joint()[1]
    found = np.random.default_rng(seed).multivariate_normal(np.zeros(12), spread)
    first = spread[:, 4:6] @ np.linalg.solve(spread[4:6, 4:6], found[4:6])
    return found - first


@pytest.mark.long
@pytest.mark.parametrize("seed", range(2))
def test_the_evidence_of_a_mover_is_that_of_the_joint_gaussian_with_the_sensor(seed: int) -> None:
    deviations = drawn(seed)
    found = driven(deviations)[0] - as_expected()
    assert found == pytest.approx(log_density(deviations), abs=0.02)


def test_a_mover_is_where_the_joint_gaussian_with_the_sensor_has_it() -> None:
    deviations, (_, spread, cross, prior) = drawn(3), joint()
    _, component = driven(deviations)
    robot = component.tracked.robot_covariance
    _, states, covariances = mover_marginals(component, component.movers.take(component.movers.decided), robot)
    gain = np.linalg.solve(spread, cross.T).T
    np.testing.assert_allclose(states[0, :2], MOVER + gain @ deviations, atol=1e-4)
    np.testing.assert_allclose(covariances[0, :2, :2], prior - gain @ cross.T, rtol=0.05, atol=1e-7)
