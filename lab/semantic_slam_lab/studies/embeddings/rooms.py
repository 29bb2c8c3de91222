"""Rooms with things that look like those of a gallery, and a robot that goes around in them."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam_lab.repetitions import keyed_generator
from semantic_slam_lab.studies.embeddings.gallery import Gallery, Thing

NUM_THINGS, NUM_STRANGE = 12, 6
"""In a room, and others, which false alarms show."""
ROOM_M, APART_M, CIRCLE_M, SIGHT_M, FIELD_RAD = 6.0, 0.7, 2.0, 3.5, np.deg2rad(100.0)
STEPS_PER_LAP = 24
MOTION_SIGMAS = np.array([0.08, 0.08, 0.06])
DETECTED, CLUTTER_PER_FRAME = 0.85, 0.15
RANGE_SIGMA_M, BEARING_SIGMA_RAD = 0.15, 0.04
CLUTTER = -1
MOST_DRAWS = 10_000


@dataclass(frozen=True, kw_only=True)
class Room:
    """A drive, and what its detections are of."""

    things: list[Thing]
    strange: list[Thing]
    keyframes: list[Keyframe]
    true_ids: list[list[int]]  # of each keyframe's detections, CLUTTER where of nothing
    seen_from: list[list[float]]  # azimuths from which each thing was seen, radians in its own frame


def make_room(gallery: Gallery, seed: int, num_keyframes: int) -> Room:
    """Drawn; the same for the same seed."""
    random = keyed_generator("embeddings", "room", gallery.network, seed)
    chosen = [gallery.things[number] for number in random.permutation(len(gallery.things))]
    things, strange = chosen[:NUM_THINGS], chosen[NUM_THINGS : NUM_THINGS + NUM_STRANGE]
    places, keyframes, true_ids = _places(random), list[Keyframe](), list[list[int]]()
    seen_from: list[list[float]] = [[] for _ in things]
    turn = 2.0 * np.pi / STEPS_PER_LAP
    step = np.array([2.0 * CIRCLE_M * np.sin(turn / 2.0), 0.0, turn])
    for k in range(num_keyframes):
        angle = turn * k - np.pi / 2.0
        robot = np.array([CIRCLE_M * np.cos(angle), CIRCLE_M * np.sin(angle), angle + np.pi / 2.0])
        told = se2.compose(step, se2.exp(random.normal(size=3) * MOTION_SIGMAS)) if k else np.zeros(3)
        seen = {number: _seen(robot, place, things[number], random) for number, place in enumerate(places)}
        found = {number: own for number, own in seen.items() if own is not None}
        for number in found:
            back = se2.between(places[number][None], robot[None])[0]
            seen_from[number].append(float(np.arctan2(back[1], back[0])))
        alarms = [_false_alarm(strange, random) for _ in range(int(random.poisson(CLUTTER_PER_FRAME)))]
        detections = [*found.values(), *alarms]
        keyframes.append(Keyframe.planar(k, motion=told, motion_sigmas=MOTION_SIGMAS, detections=detections))
        true_ids.append([*found, *([CLUTTER] * len(alarms))])
    return Room(things=things, strange=strange, keyframes=keyframes, true_ids=true_ids, seen_from=seen_from)


def _places(random: np.random.Generator) -> Array:
    """(NUM_THINGS, 3) poses, apart from each other and from the robot's way."""
    found: list[Array] = []
    for _ in range(MOST_DRAWS):
        place = np.append(random.uniform(-ROOM_M / 2.0, ROOM_M / 2.0, 2), random.uniform(-np.pi, np.pi))
        others = np.array([np.hypot(*(place - own)[:2]) for own in found])
        if (others > APART_M).all() and abs(np.hypot(*place[:2]) - CIRCLE_M) > APART_M / 2.0:
            found.append(place)
        if len(found) == NUM_THINGS:
            return np.array(found)
    raise AssertionError("things do not fit into the room")


def _seen(robot: Array, place: Array, thing: Thing, random: np.random.Generator) -> Detection | None:
    """What a detector tells of a thing, with the look of its side that the robot is on; None: nothing."""
    relative, back = se2.between(robot[None], place[None])[0], se2.between(place[None], robot[None])[0]
    distance, bearing = float(np.hypot(*relative[:2])), float(np.arctan2(relative[1], relative[0]))
    if distance > SIGHT_M or abs(bearing) > FIELD_RAD / 2.0 or random.random() > DETECTED:
        return None
    look = thing.vectors[thing.nearest(float(np.arctan2(back[1], back[0])))]
    return _detection(
        distance + random.normal(0.0, RANGE_SIGMA_M), bearing + random.normal(0.0, BEARING_SIGMA_RAD), look
    )


def _false_alarm(strange: list[Thing], random: np.random.Generator) -> Detection:
    """Anywhere, with the look of anything else."""
    thing = strange[int(random.integers(len(strange)))]
    look = thing.vectors[int(random.integers(len(thing.vectors)))]
    away = SIGHT_M * float(np.sqrt(random.uniform(0.02, 1.0)))
    return _detection(away, float(random.uniform(-FIELD_RAD / 2.0, FIELD_RAD / 2.0)), look)


def _detection(range_m: float, bearing_rad: float, look: Array) -> Detection:
    return Detection(
        range_m=max(range_m, 0.1),
        bearing_rad=bearing_rad,
        covariance=np.diag([RANGE_SIGMA_M**2, BEARING_SIGMA_RAD**2]),
        embedding=look,
    )
