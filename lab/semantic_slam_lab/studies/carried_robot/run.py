"""One drive in which the robot is carried: when it is noticed, and whether the robot is found again."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from semantic_slam.configuration import Configuration, from_dict, to_dict
from semantic_slam.errors import SemanticSlamError
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import planar_from_pose_vector
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.evidence.explanation import UNEXPLAINED
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam_lab.repetitions import keyed_generator
from semantic_slam_lab.studies.faulty_rooms.closed import configuration
from semantic_slam_lab.studies.faulty_rooms.closed_room import make_room
from semantic_slam_lab.studies.faulty_rooms.open_room import LOOP_RADIUS_M, open_room

LEAST_CARRIED_M = 3.0
FOUND_M, LIKELY = 0.5, 0.5
"""Distance from the true position up to which a robot is found again, and the least probability that it is there."""
CLOSED_BEFORE, CLOSED_AFTER, CLOSED_RADIUS_M, WALL_M = 20, 20, 0.6, 0.6
OPEN_BEFORE, OPEN_AFTER, OPEN_REACH_M = 40, 40, 3.5
START_SIGMAS = np.array([0.05, 0.05, 0.02])


@dataclass(frozen=True, kw_only=True)
class Drive:
    """K keyframes and true poses; before ``carried_at`` the robot was elsewhere."""

    engine: Engine
    keyframes: Sequence[Keyframe]
    truth: Array  # (K, 3)
    carried_at: int


@dataclass(frozen=True, kw_only=True)
class Driven:
    """What came of one drive."""

    seed: int
    noticed_after: int | None  # keyframes from the first one after it was carried on, until that is told; None: never
    false_alarms: int  # keyframes before it was carried in which that was told, or that data are unexplained
    found_after: int | None  # keyframes, from which on the robot stays found; None: not at the end
    error_m: float  # of the heaviest hypothesis's position at the end; NaN: the run ended early
    probability: float  # at the end, of positions near the true one
    cpu_s: float
    slowest_s: float  # CPU of one keyframe
    fault: str = ""  # with which the run ended


def driven(world: str, overrides: dict[str, Any], seed: int) -> Driven:
    """Draw a room of a ``world``, drive through it, be carried, drive on."""
    drive = DRIVES[world](overrides, seed)
    near, told, spent, fault, error_m = list[bool](), list[int](), list[float](), "", float("nan")
    probability = 0.0
    for k, keyframe in enumerate(drive.keyframes):
        begin = time.process_time()
        try:
            belief = drive.engine.process(keyframe)
        except SemanticSlamError as stopped:
            fault, error_m, probability = str(stopped), float("nan"), 0.0
            near.append(False)
            break
        spent.append(time.process_time() - begin)
        error_m, probability = found(belief, drive.truth[k])
        near.append(error_m < FOUND_M and probability > LIKELY)
        told += [k] if max(belief.unexplained, drive.engine.carried) > UNEXPLAINED else []
    since = [k - drive.carried_at for k in told if k >= drive.carried_at]
    after = near[drive.carried_at :]
    return Driven(
        seed=seed,
        noticed_after=since[0] if since else None,
        false_alarms=sum(k < drive.carried_at for k in told),
        found_after=len(after) - _length_of_end(after) if after and after[-1] else None,
        error_m=error_m,
        probability=probability,
        cpu_s=sum(spent),
        slowest_s=max(spent),
        fault=fault,
    )


def found(belief: HybridBelief, truth: Array) -> tuple[float, float]:
    """Distance of the heaviest hypothesis's position from the true pose (3,), and the probability of being near."""
    places = np.array([planar_from_pose_vector(pose)[:2] for pose in belief.poses])
    away = np.linalg.norm(places - truth[:2], axis=1)
    return float(away[0]), float(np.exp(belief.log_weights[away < FOUND_M]).sum())


def _length_of_end(near: Sequence[bool]) -> int:
    return next((n for n, own in enumerate(reversed(near)) if not own), len(near))


def closed_drive(overrides: dict[str, Any], seed: int) -> Drive:
    """Around furniture that is known, classes unknown."""
    random, before = keyed_generator("carried_robot", "closed", seed), make_room(seed, CLOSED_BEFORE).truth[-1, :2]
    while True:
        x, y, yaw = (*random.uniform(WALL_M, 6.0 - WALL_M, size=2), random.uniform(-np.pi, np.pi))
        if np.hypot(*([x, y] - before)) >= LEAST_CARRIED_M:
            break
    turn = np.linspace(0.0, 2.0 * np.pi, CLOSED_AFTER, endpoint=False)
    centre = np.array([x, y]) + CLOSED_RADIUS_M * np.array([-np.sin(yaw), np.cos(yaw)])
    path = centre + CLOSED_RADIUS_M * np.column_stack([np.sin(yaw + turn), -np.cos(yaw + turn)])
    room = make_room(seed, CLOSED_BEFORE, carried=np.column_stack([path, yaw + turn]))
    engine = Engine(
        with_values(configuration("known_map"), overrides),
        room.prior,
        initial_pose=room.truth[0],
        initial_covariance=np.diag(START_SIGMAS**2),
    )
    return Drive(engine=engine, keyframes=room.keyframes, truth=room.truth, carried_at=CLOSED_BEFORE)


def open_drive(overrides: dict[str, Any], seed: int) -> Drive:
    """Through a room without a map."""
    random, own = keyed_generator("carried_robot", "open", seed), with_values(configuration("open_world"), overrides)
    before = np.array([0.0, -LOOP_RADIUS_M])
    while True:
        place = random.uniform(-OPEN_REACH_M, OPEN_REACH_M, size=2)
        if np.hypot(*(place - before)) >= LEAST_CARRIED_M and np.hypot(*place) < OPEN_REACH_M:
            break
    carried = {OPEN_BEFORE: np.append(place, random.uniform(-np.pi, np.pi))}
    room = open_room(own, OPEN_BEFORE + OPEN_AFTER, random, carried)
    engine = Engine(own, initial_pose=room.truth[0], initial_covariance=np.diag(START_SIGMAS**2))
    return Drive(engine=engine, keyframes=room.keyframes, truth=room.truth, carried_at=OPEN_BEFORE)


def with_values(own: Configuration, overrides: dict[str, Any]) -> Configuration:
    """A configuration with some values, by group."""
    values = to_dict(own)
    for group, settings in overrides.items():
        values[group] |= settings
    return from_dict(values, "study")


DRIVES = {"map known": closed_drive, "own map": open_drive}
