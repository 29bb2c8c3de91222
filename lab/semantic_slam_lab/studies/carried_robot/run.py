"""One drive in which the robot is carried: when it is noticed, and whether the robot is found again."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from semantic_slam.configuration import Configuration, from_dict, to_dict
from semantic_slam.errors import SemanticSlamError
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import planar_from_pose_vector
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.evidence.model_fit import UNEXPLAINED
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam_lab.repetitions import keyed_generator
from semantic_slam_lab.studies.carried_robot.recognition import (
    in_map,
    known_before,
    num_seen_again,
    share_recognised,
)
from semantic_slam_lab.studies.faulty_rooms.closed import configuration
from semantic_slam_lab.studies.faulty_rooms.closed_room import HALF_VIEW_RAD, REACH_M, make_room
from semantic_slam_lab.studies.faulty_rooms.open_room import LOOP_RADIUS_M, open_room

LEAST_CARRIED_M = 3.0
FOUND_M, LIKELY = 0.5, 0.5
"""Distance from the true position up to which a robot is found again, and the least probability that it is there."""
SURE, FAR = 0.9, 13.8
"""Weight of a hypothesis that is sure, and squared Mahalanobis distance that it excludes (one in 1000)."""
SAVED_BEFORE, SAVED_AFTER, SAVED_RADIUS_M, WALL_M = 20, 20, 0.6, 0.6
SAVED_WHOLE = SAVED_BEFORE + SAVED_AFTER
OPEN_BEFORE, OPEN_AFTER, OPEN_REACH_M = 40, 40, 3.5
START_SIGMAS = np.array([0.05, 0.05, 0.02])


@dataclass(frozen=True, kw_only=True)
class Method:
    """Parameters by group besides those of the world, and whether the robot is carried."""

    overrides: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    is_carried: bool = True


@dataclass(frozen=True, kw_only=True)
class Drive:
    """K keyframes and true poses; before ``carried_at`` the robot was elsewhere."""

    engine: Engine
    keyframes: Sequence[Keyframe]
    truth: Array  # (K, 3)
    labels: Sequence[Sequence[int]]  # K: what each detection is of; negative: of nothing
    carried_at: int  # K: it never was
    objects: Array | None = None  # (M, 2) true places, by labels, where the map is the robot's own


@dataclass(frozen=True, kw_only=True)
class Driven:
    """What came of one drive."""

    seed: int
    noticed_after: int | None  # keyframes from the first one after it was carried on, until that is told; None: never
    false_alarms: int  # keyframes before it was carried in which that was told, or that data are unexplained
    found_after: int | None  # keyframes, from which on the robot stays found; None: not at the end
    seen_again: int  # objects that were seen before it was carried and are seen after it
    recognised: float | None  # share, at the end, of its detections since of what it knew; None: there were none
    error_m: float  # of the heaviest hypothesis's position at the end; NaN: the run ended early
    probability: float  # at the end, of positions near the true one
    is_sure_and_wrong: bool  # at the end
    cpu_s: float
    slowest_s: float  # CPU of one keyframe
    fault: str = ""  # with which the run ended


def driven(world: str, method: Method, seed: int) -> Driven:
    """Draw a room of a ``world``, drive through it, be carried, drive on."""
    drive = DRIVES[world](method, seed)
    near, told, spent, fault, error_m = list[bool](), list[int](), list[float](), "", float("nan")
    probability, wrong = 0.0, False
    for k, keyframe in enumerate(drive.keyframes):
        begin = time.process_time()
        try:
            belief = drive.engine.process(keyframe)
        except SemanticSlamError as stopped:
            fault, error_m, probability = str(stopped), float("nan"), 0.0
            near.append(False)
            break
        spent.append(time.process_time() - begin)
        error_m, probability = found(belief, _in_map(drive, belief, k))
        wrong = is_sure_and_wrong(belief, drive.truth[k])
        near.append(error_m < FOUND_M and probability > LIKELY)
        told += [k] if max(belief.unexplained, drive.engine.carried) > UNEXPLAINED else []
    since = [k - drive.carried_at for k in told if k >= drive.carried_at]
    after = near[drive.carried_at :]
    return Driven(
        seed=seed,
        noticed_after=since[0] if since else None,
        false_alarms=sum(k < drive.carried_at for k in told),
        seen_again=num_seen_again(drive.labels, drive.carried_at),
        recognised=None if fault else share_recognised(_likeliest(drive.engine), drive.labels, drive.carried_at),
        found_after=len(after) - _length_of_end(after) if after and after[-1] else None,
        error_m=error_m,
        probability=probability,
        is_sure_and_wrong=wrong,
        cpu_s=sum(spent),
        slowest_s=max(spent),
        fault=fault,
    )


def _likeliest(engine: Engine) -> list[tuple[int, ...]]:
    """Objects that the detections of each keyframe are of, as the heaviest hypothesis has it."""
    return [step.association for step in next(iter(engine.live.values())).lineage]


def _in_map(drive: Drive, belief: HybridBelief, k: int) -> Array:
    """(2,) true position at a keyframe in the map's frame: that of its own map is where it knew objects before."""
    if drive.objects is None or k < drive.carried_at:
        return np.asarray(drive.truth[k, :2])
    exists = np.flatnonzero(belief.existence > LIKELY)
    places = {int(belief.object_ids[row]): belief.object_poses[row, :2] for row in exists}
    labels = known_before(_likeliest(drive.engine), drive.labels, drive.carried_at)
    return in_map(drive.truth[k, :2], places, labels, drive.objects)


def found(belief: HybridBelief, truth: Array) -> tuple[float, float]:
    """Distance of the heaviest hypothesis's position from the true one, and the probability of being near; (2,)."""
    places = np.array([planar_from_pose_vector(pose)[:2] for pose in belief.poses])
    away = np.linalg.norm(places - truth, axis=1)
    return float(away[0]), float(np.exp(belief.log_weights[away < FOUND_M]).sum())


def is_sure_and_wrong(belief: HybridBelief, truth: Array) -> bool:
    """Whether the heaviest hypothesis has hardly any other beside it, and excludes the true position."""
    off = belief.poses[0, :2] - truth[:2]
    squared = float(off @ np.linalg.solve(belief.pose_covariances[0, :2, :2], off))
    return bool(np.exp(belief.log_weights[0]) > SURE and squared > FAR)


def _length_of_end(near: Sequence[bool]) -> int:
    return next((n for n, own in enumerate(reversed(near)) if not own), len(near))


def map_drive(name: str, method: Method, seed: int) -> Drive:
    """Around furniture that is on a map, classes unknown, with a shipped configuration."""
    sensor = {"max_range_m": REACH_M, "field_of_view_rad": 2.0 * HALF_VIEW_RAD}
    own = with_values(configuration(name), {"open_world": sensor})
    random, before = keyed_generator("carried_robot", "closed", seed), make_room(seed, SAVED_BEFORE).truth[-1, :2]
    while True:
        x, y, yaw = (*random.uniform(WALL_M, 6.0 - WALL_M, size=2), random.uniform(-np.pi, np.pi))
        if np.hypot(*([x, y] - before)) >= LEAST_CARRIED_M:
            break
    turn = np.linspace(0.0, 2.0 * np.pi, SAVED_AFTER, endpoint=False)
    centre = np.array([x, y]) + SAVED_RADIUS_M * np.array([-np.sin(yaw), np.cos(yaw)])
    path = centre + SAVED_RADIUS_M * np.column_stack([np.sin(yaw + turn), -np.cos(yaw + turn)])
    carried = np.column_stack([path, yaw + turn])
    room = make_room(seed, SAVED_BEFORE, carried=carried) if method.is_carried else make_room(seed, SAVED_WHOLE)
    engine = Engine(
        with_values(own, method.overrides),
        room.prior,
        initial_pose=room.truth[0],
        initial_covariance=np.diag(START_SIGMAS**2),
    )
    at = SAVED_BEFORE if method.is_carried else SAVED_WHOLE
    return Drive(engine=engine, keyframes=room.keyframes, truth=room.truth, labels=room.associations, carried_at=at)


def open_drive(method: Method, seed: int) -> Drive:
    """Through a room without a map."""
    random = keyed_generator("carried_robot", "open", seed)
    own = with_values(configuration("open_world"), method.overrides)
    before = np.array([0.0, -LOOP_RADIUS_M])
    while True:
        place = random.uniform(-OPEN_REACH_M, OPEN_REACH_M, size=2)
        if np.hypot(*(place - before)) >= LEAST_CARRIED_M and np.hypot(*place) < OPEN_REACH_M:
            break
    carried = {OPEN_BEFORE: np.append(place, random.uniform(-np.pi, np.pi))}
    room = open_room(own, OPEN_BEFORE + OPEN_AFTER, random, carried if method.is_carried else None)
    engine = Engine(own, initial_pose=room.truth[0], initial_covariance=np.diag(START_SIGMAS**2))
    at = OPEN_BEFORE if method.is_carried else len(room.keyframes)
    return Drive(
        engine=engine,
        keyframes=room.keyframes,
        truth=room.truth,
        labels=room.labels,
        carried_at=at,
        objects=room.objects[:, :2],
    )


def with_values(own: Configuration, overrides: Mapping[str, Mapping[str, Any]]) -> Configuration:
    """A configuration with some values, by group."""
    values = to_dict(own)
    for group, settings in overrides.items():
        values[group] |= settings
    return from_dict(values, "study")


DRIVES: Mapping[str, Callable[[Method, int], Drive]] = {
    "saved map": partial(map_drive, "second_session"),
    "known map": partial(map_drive, "known_map"),
    "default": partial(map_drive, "default"),
    "own map": open_drive,
}
