"""What is wrong with a closed room's data or with its map, and what may rightly be said of its detections then."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam_lab.studies.faulty_rooms.closed_room import (
    HALF_VIEW_RAD,
    REACH_M,
    ClosedRoom,
    first_view,
    some_views,
    with_map_known_to,
    with_swapped_scores,
    without_object,
)

LEAST_SIGHTS = 3
"""Detections of an object that is missing or displaced: what is hardly seen cannot be found out."""
DISPLACED_M, SURVEYED_M = 1.0, 0.1
TENTH, HUNDREDTH = 0.1, 0.01


@dataclass(frozen=True, kw_only=True)
class FaultyRoom:
    """A closed room with what the map says of it wrongly."""

    room: ClosedRoom
    missing: frozenset[int] = frozenset()  # objects that the map lacks
    displaced: frozenset[int] = frozenset()  # objects that the map has elsewhere
    outliers: frozenset[tuple[int, int]] = field(default_factory=frozenset)  # (keyframe, detection) of nothing

    def wrong_at(self, keyframe: int) -> list[int | None]:
        """Object of each detection of a keyframe; None for what is of nothing."""
        objects = self.room.associations[keyframe]
        return [None if (keyframe, row) in self.outliers else number for row, number in enumerate(objects)]


def _nothing(room: ClosedRoom, seed: int) -> FaultyRoom:
    return FaultyRoom(room=room)


def _first_view(room: ClosedRoom, seed: int) -> FaultyRoom:
    return FaultyRoom(room=with_swapped_scores(room, [first_view(room)], seed))


def _tenth_of_views(room: ClosedRoom, seed: int) -> FaultyRoom:
    return FaultyRoom(room=with_swapped_scores(room, some_views(room, TENTH, seed), seed))


def _missing_object(room: ClosedRoom, seed: int) -> FaultyRoom:
    number = int(np.random.default_rng([21, seed]).choice(_well_seen(room)))
    return FaultyRoom(room=without_object(room, number), missing=frozenset({number}))


def _displaced_objects(room: ClosedRoom, seed: int) -> FaultyRoom:
    """Two of them, 1 m away in any direction."""
    random = np.random.default_rng([22, seed])
    numbers = frozenset(int(n) for n in random.choice(_well_seen(room), 2, replace=False))
    objects = []
    for item in room.prior.objects:
        angle, pose = random.uniform(-np.pi, np.pi), item.pose.copy()
        if item.object_id in numbers:
            pose[:2] += DISPLACED_M * np.array([np.cos(angle), np.sin(angle)])
        objects.append(replace(item, pose=pose))
    return FaultyRoom(room=replace(room, prior=MapPrior(tuple(objects))), displaced=numbers)


def _displaced_on_survey(room: ClosedRoom, seed: int) -> FaultyRoom:
    """Two objects 1 m away from where a map has them that is known about as well as one detection tells a place."""
    return _displaced_objects(with_map_known_to(room, SURVEYED_M), seed)


def _outliers(room: ClosedRoom, seed: int) -> FaultyRoom:
    """A hundredth of the detections, and one at least, anywhere in the sensor's region."""
    random, keyframes = np.random.default_rng([23, seed]), list(room.keyframes)
    every = [(k, row) for k, own in enumerate(room.associations) for row in range(len(own))]
    count = max(1, round(HUNDREDTH * len(every)))
    wrong = frozenset(every[n] for n in random.choice(len(every), count, replace=False))
    for k, row in sorted(wrong):
        measured = keyframes[k].measurements
        ranges, bearings = measured.ranges_m.copy(), measured.bearings_rad.copy()
        ranges[row], bearings[row] = REACH_M * np.sqrt(random.random()), random.uniform(-HALF_VIEW_RAD, HALF_VIEW_RAD)
        keyframes[k] = replace(keyframes[k], measurements=replace(measured, ranges_m=ranges, bearings_rad=bearings))
    return FaultyRoom(room=replace(room, keyframes=tuple(keyframes)), outliers=wrong)


FAULTS: dict[str, Callable[[ClosedRoom, int], FaultyRoom]] = {
    "nothing wrong": _nothing,
    "first view wrong": _first_view,
    "10 % of views wrong": _tenth_of_views,
    "an object not on the map": _missing_object,
    "two objects displaced by 1 m": _displaced_objects,
    "two objects displaced by 1 m, map to 0.1 m": _displaced_on_survey,
    "1 % of places anywhere": _outliers,
}


def _well_seen(room: ClosedRoom) -> list[int]:
    """Objects with sights enough; the two that are seen most in a drive so short that fewer have."""
    counts = np.bincount([number for own in room.associations for number in own], minlength=len(room.prior.objects))
    most = np.sort(np.argsort(-counts, kind="stable")[:2])
    enough = np.flatnonzero(counts >= LEAST_SIGHTS)
    found: list[int] = (enough if len(enough) >= len(most) else most).tolist()
    return found
