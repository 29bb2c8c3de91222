"""Worlds of chapter 4: objects that look alike and a robot that does not know where it is; given, and at random."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.planar.frames import object_in_body

RANDOM_OBJECTS = 6
RANDOM_STEPS = 10
LEAST_SEPARATION_M = 2.5
"""Between objects of a random layout."""
LEAST_CLEARANCE_M = 1.5
"""Between the objects of a random layout and the path."""
MARGIN_M = 5.0
"""How far beyond the path a random layout reaches."""
LONG_TURNS = (-0.125, -0.125, *[0.0] * 15, *[0.09] * 8)
"""Turns [rad] of the example's 25 steps: past the row of objects to the two that stand apart, as in Fig. 4.3a."""


@dataclass(frozen=True)
class Scenario:
    """A planar world; variances in m^2 and rad^2, tangent spaces of SE(2) for poses."""

    objects: Array  # (O, 3)
    start: Array  # (3,) of the robot
    start_mean: Array  # (3,) mean of the prior of the start
    start_variance: Array  # (3,)
    object_variance: Array  # (3,) of the map that the robot is given
    process_variance: Array  # (3,)
    range_bearing_variance: Array  # (2,)
    max_range_m: float
    field_of_view_rad: float
    max_detections: int
    concentration: float  # K of the semantic noise
    step_m: float  # forward motion between keyframes


def given_scenario() -> tuple[Scenario, Array]:
    """The scenario of ``scenarios/ch4_layout.json`` and its (50, 10, 3) paths of SE(2) increments."""
    row = settings()
    start, paths = np.array(row["start"]), np.array(row["paths"])
    return Scenario(
        objects=np.array(row["objects"]),
        start=start,
        start_mean=start + np.append(row["initial_mean_offset"], 0.0),
        start_variance=np.array(row["initial_pose_variance"]),
        object_variance=np.array(row["object_prior_variance"]),
        process_variance=np.array(row["process_variance"]),
        range_bearing_variance=np.array(row["range_bearing_variance"]),
        max_range_m=float(row["visibility"]["max_range"]),
        field_of_view_rad=float(row["visibility"]["field_of_view"]),
        max_detections=int(row["max_detections_per_frame"]),
        concentration=float(row["semantic_K"]),
        step_m=float(paths[0, 0, 0]),
    ), paths


def settings() -> Mapping[str, Any]:
    """Settings of the chapter-4 worlds, from ``scenarios/ch4_layout.json``."""
    text = (files("semantic_slam_lab.studies") / "scenarios" / "ch4_layout.json").read_text(encoding="utf-8")
    found: Mapping[str, Any] = json.loads(text)
    return found


def long_path(scenario: Scenario) -> Array:
    """(25, 3) increments of the example's track."""
    return _forward(scenario.step_m, np.array(LONG_TURNS))


def random_scenario(generator: np.random.Generator) -> tuple[Scenario, Array]:
    """Noise as given, but a wandering path of its own, (10, 3), objects scattered about it and a prior mean drawn.

    The first keyframe of the path sees an object: a robot that has seen nothing yet has the covariance of its prior,
    whose determinant would drown all others in an average.
    """
    given, _ = given_scenario()
    start = np.array([0.0, 0.0, generator.uniform(-np.pi, np.pi)])
    turns = np.clip(np.cumsum(generator.normal(0.0, 0.06, RANDOM_STEPS)), -0.25, 0.25)
    path = _forward(given.step_m, turns)
    error = se2.exp(generator.normal(size=3) * np.sqrt(given.start_variance))
    mean = se2.compose(start, se2.inverse(error))
    track = walk(start, path)
    while True:
        objects = _scattered(track[:, :2], generator)
        scenario = replace(given, objects=objects, start=start, start_mean=mean)
        if len(visible(scenario, track[1])):
            return scenario, path


def walk(start: Array, controls: Array) -> Array:
    """(K + 1, 3) poses from ``start`` along (K, 3) increments, without noise."""
    poses = [start]
    for control in controls:
        poses.append(se2.compose(poses[-1], control))
    return np.array(poses)


def visible(scenario: Scenario, pose: Array) -> NDArray[np.int_]:
    """(D,) objects inside range and field of view, the nearest ones where there are too many."""
    distance, bearing = range_bearing(pose, scenario.objects)
    inside = (distance <= scenario.max_range_m) & (np.abs(bearing) <= scenario.field_of_view_rad / 2.0)
    nearest = np.argsort(distance, kind="stable")
    return np.asarray(nearest[inside[nearest]][: scenario.max_detections])


def range_bearing(pose: Array, objects: Array) -> tuple[Array, Array]:
    """(O,) distances [m] and bearings [rad] of (O, 3) objects from a robot pose (3,)."""
    d = object_in_body(np.broadcast_to(pose, objects.shape), objects)
    return np.hypot(d[:, 0], d[:, 1]), np.arctan2(d[:, 1], d[:, 0])


def _forward(step_m: float, turns: Array) -> Array:
    return np.stack([np.full(len(turns), step_m), np.zeros(len(turns)), turns], axis=1)


def _scattered(track: Array, generator: np.random.Generator) -> Array:
    """(O, 3) objects in the rectangle about the track (K, 2), apart from it and from each other."""
    low, high = track.min(axis=0) - MARGIN_M, track.max(axis=0) + MARGIN_M
    placed: list[Array] = []
    while len(placed) < RANDOM_OBJECTS:
        spot = generator.uniform(low, high)
        near_track = np.linalg.norm(track - spot, axis=1).min() < LEAST_CLEARANCE_M
        if near_track or any(np.linalg.norm(spot - other[:2]) < LEAST_SEPARATION_M for other in placed):
            continue
        placed.append(np.append(spot, generator.uniform(-np.pi, np.pi)))
    return np.array(placed)
