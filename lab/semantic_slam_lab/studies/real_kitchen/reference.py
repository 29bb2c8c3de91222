"""What stands in the kitchen, from boxes, depth and the given poses alone: three chairs and two mugs.

Nobody has labelled the pictures. What is known is how many there are; where is the median of the detected places of
each under the given poses.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from semantic_slam.evaluation.record import Record
from semantic_slam.evaluation.trajectory import interpolate
from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import planar_from_pose_vector

COUNTS = {"chair": 3, "cup": 2}
"""Objects of each of the detector's classes that are there; its cups are the two mugs."""
ONE_OBJECT_M = 0.35
"""Detected places so near to each other are of one object."""


@dataclass(frozen=True)
class Standing:
    """O objects that are there."""

    names: tuple[str, ...]  # chair 1, chair 2, ...
    classes: tuple[str, ...]
    positions: Array  # (O, 2) in map
    detections: tuple[int, ...]  # that their positions are the medians of


def standing(record: Record, counts: Mapping[str, int] = COUNTS) -> Standing:
    """Objects of each class, in their true number, at the places that most detections agree on."""
    names: list[str] = []
    classes: list[str] = []
    positions: list[Array] = []
    numbers: list[int] = []
    for class_name, count in counts.items():
        for number, (position, agreeing) in enumerate(agreed_places(places_of(record, class_name), count)):
            names.append(f"{class_name} {number + 1}")
            classes.append(class_name)
            positions.append(position)
            numbers.append(agreeing)
    return Standing(tuple(names), tuple(classes), np.array(positions).reshape(-1, 2), tuple(numbers))


def places_of(record: Record, label: str) -> Array:
    """(N, 2) places in map of all detections of that label, under the true poses."""
    assert record.truth is not None
    stamps = np.array(sorted(record.measurements), dtype=np.int64)
    poses = planar_from_pose_vector(interpolate(record.truth.trajectory, stamps))
    found = []
    for stamp, pose in zip(stamps.tolist(), poses, strict=True):
        seen = record.measurements[stamp]
        rows = [row for row, own in enumerate(seen.labels) if own == label and np.isfinite(seen.ranges_m[row])]
        ranges, bearings = seen.ranges_m[rows], seen.bearings_rad[rows]
        level = np.column_stack([ranges * np.cos(bearings), ranges * np.sin(bearings), np.zeros(len(rows))])
        found.append(se2.compose(pose, level)[:, :2])
    return np.concatenate(found) if found else np.zeros((0, 2))


def agreed_places(places: Array, count: int) -> list[tuple[Array, int]]:
    """Up to ``count`` medians (2,) of (N, 2) places, each with how many agree on it, most first."""
    found: list[tuple[Array, int]] = []
    left = places
    while len(left) and len(found) < count:
        near = np.linalg.norm(left[:, None] - left[None], axis=2) <= ONE_OBJECT_M
        most = near[near.sum(axis=1).argmax()]
        position = np.median(left[most], axis=0)
        found.append((position, int(most.sum())))
        away = np.linalg.norm(left - position, axis=1) > ONE_OBJECT_M
        left = left[away & ~most]
    return found
