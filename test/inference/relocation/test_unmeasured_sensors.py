"""With ``config/detector.yaml`` a robot is not taken for carried because its sensor is another one than usual."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from semantic_slam import Engine
from semantic_slam.configuration import Configuration, load_configuration
from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.shipped import configuration_file

LAP, RADIUS_M, NUM_KEYFRAMES = 45, 3.0, 80
STEP = np.array([2.0 * np.pi * RADIUS_M / LAP, 0.0, 2.0 * np.pi / LAP])
STEP_SIGMAS, SIGHT_SIGMAS = np.array([0.02, 0.01, 0.01]), np.array([0.05, 0.02])
THINGS = 16


@dataclass(frozen=True)
class Sensor:
    """A camera: where it looks, how far, and how often it detects."""

    direction_rad: float = 0.0
    reach_m: float = 4.5
    probability: float = 0.9


SENSORS = {"aside": Sensor(direction_rad=-0.7), "short": Sensor(reach_m=2.7), "dim": Sensor(probability=0.5)}


def room(random: np.random.Generator) -> Array:
    """(THINGS, 2) beside the robot's circle, at least a metre from one another."""
    places = np.zeros((0, 2))
    while len(places) < THINGS:
        new = random.uniform(-6.0, 6.0, size=2)
        is_beside = 0.7 < abs(np.hypot(*new) - RADIUS_M) < 2.5
        if is_beside and (np.hypot(*(places - new).T) > 1.0).all():
            places = np.concatenate([places, [new]])
    return places


def drive(sensor: Sensor, seed: int) -> list[Keyframe]:
    """Nearly two laps, of which odometry tells all, with a false alarm in ten frames."""
    random = np.random.default_rng(seed)
    places, pose, keyframes = room(random), np.array([0.0, -RADIUS_M, 0.0]), list[Keyframe]()
    for k in range(NUM_KEYFRAMES):
        if k:
            pose = se2.compose(se2.compose(pose, STEP), se2.exp(random.normal(size=3) * STEP_SIGMAS))
        offset = places - pose[:2]
        polar = np.stack([np.hypot(*offset.T), wrap_angle(np.arctan2(offset[:, 1], offset[:, 0]) - pose[2])], axis=1)
        aside = np.abs(wrap_angle(polar[:, 1] - sensor.direction_rad))
        in_view = (polar[:, 0] > 0.4) & (polar[:, 0] < sensor.reach_m) & (aside < 0.65)
        told = polar[in_view & (random.random(len(polar)) < sensor.probability)]
        told = told + random.normal(size=told.shape) * SIGHT_SIGMAS
        if random.random() < 0.1:
            false = [
                sensor.reach_m * np.sqrt(random.uniform(0.05, 1.0)),
                sensor.direction_rad + random.uniform(-0.6, 0.6),
            ]
            told = np.concatenate([told, [false]])
        sights = [Detection(range_m=r, bearing_rad=b, covariance=np.diag(SIGHT_SIGMAS**2)) for r, b in told.tolist()]
        motion = STEP if k else np.zeros(3)
        keyframes.append(Keyframe.planar(k, motion=motion, detections=sights, motion_sigmas=STEP_SIGMAS))
    return keyframes


def carried_in(configuration: Configuration, keyframes: list[Keyframe]) -> int:
    """Number of keyframes in which the robot is taken for carried."""
    engine = Engine(configuration, initial_covariance=np.diag([0.01, 0.01, 0.01]) ** 2)
    for keyframe in keyframes:
        engine.process(keyframe)
    return sum(last - first + 1 for first, last in engine.carried_spans.spans)


@pytest.mark.long
@pytest.mark.parametrize("name", sorted(SENSORS))
def test_who_drives_on_is_not_taken_for_carried(name: str) -> None:
    """With a usual camera's region and rates stated it was, in 59, 39 and 15 keyframes."""
    shipped = load_configuration(configuration_file("detector"))
    by_places = replace(shipped, semantic_model=replace(shipped.semantic_model, kind="none"))
    assert carried_in(by_places, drive(SENSORS[name], 1)) == 0
