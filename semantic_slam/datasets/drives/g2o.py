"""Landmark graphs in the plane, in g2o's text format.

Read are VERTEX_SE2 id x y yaw, VERTEX_XY id x y, EDGE_SE2 from to dx dy dyaw and EDGE_SE2_XY pose landmark dx dy, each
edge with the upper triangle of its information matrix. Poses are in the order of their ids, and odometry is the edges
from each to the next; other edges between poses (closures that somebody else found) and other records are counted.
"""

from collections import Counter
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np

from semantic_slam.datasets.drives.tables import Line, lines_of, numbers
from semantic_slam.errors import InputError, shortened
from semantic_slam.geometry.arrays import Array
from semantic_slam.reasons import LONGEST_NAME

REMEDY = "name a g2o file of VERTEX_SE2, EDGE_SE2 and EDGE_SE2_XY"
RECORDS = {
    "VERTEX_SE2": ("id", "x", "y", "yaw"),
    "VERTEX_XY": ("id", "x", "y"),
    "EDGE_SE2": ("from", "to", "dx", "dy", "dyaw", *("I11", "I12", "I13", "I22", "I23", "I33")),
    "EDGE_SE2_XY": ("pose", "landmark", "dx", "dy", "I11", "I12", "I22"),
}


@dataclass(frozen=True)
class Sighting:
    """One landmark seen from one pose."""

    landmark: int  # id in the file
    position: Array  # (2,) x y in the robot's frame, metres
    covariance: Array  # (2, 2)


@dataclass(frozen=True)
class LandmarkGraph:
    """K poses in the order of the drive."""

    increments: Array  # (K - 1, 3) T_k_k+1: dx dy [m] dyaw [rad]
    sightings: list[list[Sighting]]  # (K,)
    left_out: Counter[str]  # records that are not used, by their name


@dataclass
class _Records:
    poses: set[int] = field(default_factory=set)
    steps: dict[tuple[int, int], list[float]] = field(default_factory=dict)
    sightings: list[tuple[Line, int, Sighting]] = field(default_factory=list)
    left_out: Counter[str] = field(default_factory=Counter)


def read_graph(path: Path) -> LandmarkGraph:
    """The graph of a file, compressed by gzip or not; raises InputError with the line that is wrong."""
    records = _Records()
    for line in lines_of(path, REMEDY):
        _read(line, records)
    order = sorted(records.poses)
    if not records.sightings or len(order) < 2:
        others = (
            f", besides {shortened([kind[:LONGEST_NAME] for kind in sorted(records.left_out)])}"
            if records.left_out
            else ""
        )
        seen = f"{len(order)} poses and {len(records.sightings)} sightings of landmarks{others}"
        raise InputError(f"{path}: {seen}; {REMEDY}")
    broken = [pair for pair in pairwise(order) if pair not in records.steps]
    if broken:
        before, after = broken[0]
        raise InputError(f"{path}: no EDGE_SE2 from pose {before} to the next, {after}; add it, odometry is one chain")
    increments = np.array([records.steps.pop(pair) for pair in pairwise(order)])
    records.left_out["EDGE_SE2 between poses that do not follow each other"] += len(records.steps)
    return LandmarkGraph(increments, _by_pose(records, order), +records.left_out)


def _read(line: Line, records: _Records) -> None:
    kind = line.words[0]
    if kind not in RECORDS:
        records.left_out[kind] += 1
        return
    values = numbers(Line(line.path, line.number, line.words[1:]), RECORDS[kind], REMEDY)
    if kind == "VERTEX_SE2":
        records.poses.add(int(values[0]))
    elif kind == "EDGE_SE2":
        records.steps[int(values[0]), int(values[1])] = values[2:5]
    elif kind == "EDGE_SE2_XY":
        information = np.array([[values[4], values[5]], [values[5], values[6]]])
        if np.linalg.eigvalsh(information)[0] <= 0.0:
            raise line.fault("information that is not positive definite", "correct the edge")
        sighting = Sighting(int(values[1]), np.array(values[2:4]), np.linalg.inv(information))
        records.sightings.append((line, int(values[0]), sighting))


def _by_pose(records: _Records, order: list[int]) -> list[list[Sighting]]:
    row_of = {pose: row for row, pose in enumerate(order)}
    seen: list[list[Sighting]] = [[] for _ in order]
    for line, pose, sighting in records.sightings:
        if pose not in row_of:
            raise line.fault(f"a landmark is seen from pose {pose}, of which there is no VERTEX_SE2", "add the vertex")
        seen[row_of[pose]].append(sighting)
    return seen
