"""A camera that flies over tables: things of few kinds upon them, a detector with depth, odometry that drifts.

What the detector errs by it says; its boxes are whole. Tables hide nothing that stands upon them, for the camera is
higher.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from semantic_slam.geometry import se3, so3
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.models.spatial.camera import Camera
from semantic_slam.inference.open_world.spatial.region import SpatialRegion
from semantic_slam_lab.simulation.detectors.detector_words import DetectorFaults, Hypotheses, Seen, alarm, hypotheses

NAMES = ("cup", "bottle", "book", "laptop")
"""What stands on tables: several of each."""
OTHERS = ("bowl", "vase", "remote", "mouse", "keyboard", "cell phone")
"""Further names of the detector, which nothing deserves."""
TABLES = np.array([[-1.2, -0.9], [1.1, -1.0], [-1.0, 1.0], [1.2, 0.9]])
"""Centres [m]."""
TABLE_SIZE_M, TABLE_HEIGHT_M = np.array([1.2, 0.7]), 0.75
LEAST_APART_M = 0.2
THING_RADIUS_M = 0.05
LOOP_M, LOOP_HEIGHT_M, ROUNDS = np.array([2.6, 2.3]), 1.5, 2.0
"""Half axes of the loop around the tables, the height of the camera, and how often it is flown."""
T_BODY_CAMERA = se3.compose(
    np.array([0.08, 0.02, 0.04, 0.0, 0.0, 0.0, 1.0]), np.array([0.0, 0.0, 0.0, -0.5, 0.5, -0.5, 0.5])
)


@dataclass(frozen=True, kw_only=True)
class Flight:
    """How a camera flies and what it sees."""

    keyframes: int = 80
    things: int = 16
    odometry_share: float = 0.02  # of every motion, by which it errs
    odometry_floor: tuple[float, float] = (0.003, 0.002)  # [m, rad], by which it errs besides
    gravity_rad: float = 0.002  # by which roll and pitch err in a step: an inertial sensor knows what is down
    ray_rad: float = 0.008
    range_m: float = 0.02
    range_share: float = 0.01  # of the range, by which it errs besides
    depth: bool = True  # False: the detector shows rays alone
    faults: DetectorFaults = field(
        default_factory=lambda: DetectorFaults(confused=0.1, dropped=0.1, alarms_per_frame=0.1, names=(*NAMES, *OTHERS))
    )


@dataclass(frozen=True, kw_only=True)
class TableTops:
    """A room, and what a flight through it gives; K keyframes."""

    things: Array  # (N, 3)
    names: tuple[str, ...]  # (N,)
    truth: Array  # (K, 7) body in map
    keyframes: Sequence[Keyframe]
    seen: Sequence[tuple[int, ...]]  # K x D of which thing each detection is, -1: a false alarm


def table_tops(flight: Flight, region: SpatialRegion, random: np.random.Generator) -> TableTops:
    """Draw a room and fly through it; ``region`` is what the camera covers."""
    things = _things(flight.things, random)
    names = tuple(NAMES[n % len(NAMES)] for n in range(flight.things))
    truth = _path(flight.keyframes, random)
    keyframes, seen = [], []
    for k, pose in enumerate(truth):
        before = truth[max(k - 1, 0)]
        motion, covariance = _odometry(flight, se3.between(before, pose), random)
        detections, numbers = _detections(flight, region, pose, things, names, random)
        keyframes.append(
            Keyframe.spatial(
                k,
                motion=motion,
                motion_covariance=covariance,
                detections=detections,
                T_body_camera=T_BODY_CAMERA,
            )
        )
        seen.append(numbers)
    return TableTops(things=things, names=names, truth=truth, keyframes=keyframes, seen=seen)


def _things(count: int, random: np.random.Generator) -> Array:
    """(N, 3) on the tables, no two nearer than they may be."""
    placed: list[Array] = []
    while len(placed) < count:
        table = TABLES[random.integers(len(TABLES))]
        place = np.append(
            table + TABLE_SIZE_M * random.uniform(-0.5, 0.5, 2), TABLE_HEIGHT_M + random.uniform(0.03, 0.15)
        )
        if all(np.linalg.norm(place - other) >= LEAST_APART_M for other in placed):
            placed.append(place)
    return np.array(placed)


def _path(count: int, random: np.random.Generator) -> Array:
    """(K, 7) poses of the body: around the tables, looking down on them, with a hand that sways."""
    turns = 2.0 * np.pi * ROUNDS * np.arange(count) / count
    poses = np.empty((count, 7))
    sway = _smooth(count, 6, random)
    for k, turn in enumerate(turns):
        place = np.append(LOOP_M * [np.cos(turn), np.sin(turn)], LOOP_HEIGHT_M) + 0.15 * sway[k, :3]
        target = np.array([0.6 * np.cos(turn + 0.8), 0.6 * np.sin(turn + 0.8), TABLE_HEIGHT_M])
        away = target - place
        yaw, down = np.arctan2(away[1], away[0]), np.arctan2(-away[2], np.hypot(*away[:2]))
        level = so3.product(so3.exp(np.array([0.0, 0.0, yaw])), so3.exp(np.array([0.0, down, 0.0])))
        poses[k] = np.append(place, so3.product(level, so3.exp(0.08 * sway[k, 3:])))
    return se3.wrapped(poses)


def _smooth(count: int, size: int, random: np.random.Generator) -> Array:
    """(count, size) random walks that return to 0, of standard deviation 1."""
    found, keep = np.zeros((count, size)), 0.8
    for k in range(1, count):
        found[k] = keep * found[k - 1] + np.sqrt(1.0 - keep**2) * random.normal(size=size)
    return found


def _odometry(flight: Flight, motion: Array, random: np.random.Generator) -> tuple[Array, Array]:
    """A motion (7,) as odometry has it, and the (6, 6) covariance that it tells."""
    travelled, turned = np.linalg.norm(motion[:3]), np.linalg.norm(so3.log(motion[3:]))
    place = np.hypot(flight.odometry_floor[0], flight.odometry_share * travelled)
    yaw = np.hypot(flight.odometry_floor[1], flight.odometry_share * turned)
    sigmas = np.array([flight.gravity_rad, flight.gravity_rad, yaw, place, place, place])
    told = se3.retract(motion, -sigmas * random.normal(size=6))
    return told, np.diag(sigmas[se3.TO_MESSAGE] ** 2)


def _detections(
    flight: Flight, region: SpatialRegion, pose: Array, things: Array, names: Sequence[str], random: np.random.Generator
) -> tuple[list[Detection], tuple[int, ...]]:
    """What the detector shows in a shuffled order, and of what each is."""
    camera = Camera(T_BODY_CAMERA)
    seen = camera.seen(so3.rotated(so3.inverse(pose[3:]), things - pose[:3]))
    inside = np.flatnonzero(region.holds(seen))
    found: list[tuple[Detection, int]] = []
    for n in inside.tolist():
        others = np.delete(inside, np.flatnonzero(inside == n))
        if _is_hidden(seen[n], seen[others]) or random.random() < flight.faults.dropped:
            continue
        away = camera.on(pose)[:3] - things[n]
        words = hypotheses(_seen(names[n], n, away), flight.faults, random)
        found.append((_detection(flight, seen[n], words, random), n))
    for _ in range(random.poisson(flight.faults.alarms_per_frame)):
        x, y = np.tan([region.half_width_rad, region.half_height_rad]) * random.uniform(-1.0, 1.0, 2)
        ray = np.array([x, y, 1.0])
        reach = np.cbrt(random.uniform(region.min_range_m**3, region.max_range_m**3))
        place = reach * ray / np.linalg.norm(ray)
        found.append((_detection(flight, place, alarm(flight.faults, random), random), -1))
    order = random.permutation(len(found))
    return [found[n][0] for n in order], tuple(found[n][1] for n in order)


def _seen(name: str, number: int, away: Array) -> Seen:
    return Seen(name=name, number=number, azimuth_rad=float(np.arctan2(away[1], away[0])))


def _is_hidden(seen: Array, others: Array) -> bool:
    """Whether one of the others stands before a thing (3,), from where they are seen."""
    distance = np.linalg.norm(seen)
    along = others @ seen / distance
    aside = np.linalg.norm(others - along[:, None] * seen / distance, axis=1)
    return bool(((along > 0.0) & (along < distance - THING_RADIUS_M) & (aside < THING_RADIUS_M)).any())


def _detection(flight: Flight, seen: Array, words: Hypotheses, random: np.random.Generator) -> Detection:
    distance = float(np.linalg.norm(seen))
    sigma = float(np.hypot(flight.range_m, flight.range_share * distance))
    if not flight.depth:
        return Detection.along(
            seen / distance + flight.ray_rad * random.normal(size=3),
            ray_covariance=flight.ray_rad**2 * np.eye(3),
            T_body_sensor=T_BODY_CAMERA,
            label=words.names[0],
            score=words.scores[0],
            class_scores=dict(zip(words.names, words.scores, strict=True)),
        )
    return Detection.along(
        seen / distance + flight.ray_rad * random.normal(size=3),
        max(distance + sigma * random.normal(), 0.05),
        sigma_range_m=sigma,
        ray_covariance=flight.ray_rad**2 * np.eye(3),
        T_body_sensor=T_BODY_CAMERA,
        label=words.names[0],
        score=words.scores[0],
        class_scores=dict(zip(words.names, words.scores, strict=True)),
    )
