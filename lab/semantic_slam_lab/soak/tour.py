"""A building toured over and over: a closed corridor with things on both sides; detections are drawn directly."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from semantic_slam.configuration import Configuration
from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.inputs.detection import Detection
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.models.noise.odometry_noise import odometry_covariance
from semantic_slam_lab.repetitions import keyed_generator

STEP_M = 0.5
"""Between keyframes on a straight."""
CORNER_STEPS = 3
"""Keyframes in which the robot turns by a right angle on the spot."""
LENGTH_STEPS, WIDTH_STEPS = 24, 12
"""Keyframes along the sides of the corridor."""
BESIDE_M, APART_M, SHIFTED_M = 1.6, 2.5, 0.5
"""Things from the middle of the corridor, from one thing to the next, and off that."""
LEAST_RANGE_M, MOST_RANGE_M, FIELD_OF_VIEW_RAD = 0.4, 4.5, 1.3
DETECTED, CLUTTER_PER_FRAME = 0.9, 0.02


@dataclass(frozen=True)
class Seen:
    """A keyframe, and where the robot truly is."""

    keyframe: Keyframe
    pose: Array  # (3,) in map


@dataclass
class Tour:
    """Keyframes of a robot whose odometry and detections err as the configuration says; one after another, for ever."""

    configuration: Configuration
    seed: int = 0
    _random: np.random.Generator = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._random = keyed_generator("soak", self.seed)

    def keyframes(self) -> Iterator[Seen]:
        """Round after round from the corner at (0, 0)."""
        pose, things, index = np.zeros(3), self.things(), 0
        while True:
            for motion in _round():
                pose = se2.compose(pose, motion)
                yield Seen(self._keyframe(index, motion, pose, things), pose)
                index += 1

    @staticmethod
    def things() -> Array:
        """(M, 2) in map, along both walls of the corridor, at places that do not repeat."""
        length, width = STEP_M * LENGTH_STEPS, STEP_M * WIDTH_STEPS
        random, found = keyed_generator("soak", "things"), []
        for off in (-BESIDE_M, BESIDE_M):
            low, right, top = off, length - off, width - off
            corners = np.array([[low, low], [right, low], [right, top], [low, top], [low, low]])
            for start, end in pairwise(corners):
                side = np.linalg.norm(end - start)
                places = np.arange(0.5 * APART_M, side, APART_M) + random.uniform(-SHIFTED_M, SHIFTED_M)
                places += random.uniform(-SHIFTED_M, SHIFTED_M, size=len(places))
                found.append(start + np.outer(places / side, end - start))
        return np.concatenate(found)

    def _keyframe(self, index: int, motion: Array, pose: Array, things: Array) -> Keyframe:
        covariance = odometry_covariance(
            float(np.hypot(*motion[:2])), abs(float(motion[2])), self.configuration.odometry
        )
        sigmas = np.sqrt(np.diag(covariance))
        told = se2.compose(motion, se2.exp(sigmas * self._random.normal(size=3)))
        return Keyframe.planar(index, motion=told, detections=self._detections(pose, things), motion_sigmas=sigmas)

    def _detections(self, pose: Array, things: Array) -> list[Detection]:
        cos, sin = np.cos(pose[2]), np.sin(pose[2])
        x, y = ((things - pose[:2]) @ np.array([[cos, -sin], [sin, cos]])).T
        ranges, bearings = np.hypot(x, y), np.arctan2(y, x)
        inside = (ranges > LEAST_RANGE_M) & (ranges < MOST_RANGE_M) & (np.abs(bearings) < 0.5 * FIELD_OF_VIEW_RAD)
        rows = np.flatnonzero(inside & (self._random.random(len(things)) < DETECTED))
        found = [self._detection(ranges[row], bearings[row], f"thing {row}") for row in rows.tolist()]
        if self.configuration.association != "given" and self._random.random() < CLUTTER_PER_FRAME:
            found.append(self._detection(self._random.uniform(1.0, 4.0), self._random.uniform(-0.6, 0.6), ""))
        return found

    def _detection(self, range_m: float, bearing_rad: float, name: str) -> Detection:
        perception, (one, other) = self.configuration.perception, self._random.normal(size=2)
        sigma_m = np.hypot(perception.sigma_range_m, perception.sigma_range_per_m * range_m)
        return Detection(
            range_m=max(float(range_m + sigma_m * one), 0.05),
            bearing_rad=float(bearing_rad + perception.sigma_bearing_rad * other),
            track_id=name,
        )


def _round() -> list[Array]:
    """Motions (3,) once about the corridor, counter-clockwise."""
    ahead, turn = np.array([STEP_M, 0.0, 0.0]), np.array([0.0, 0.0, 0.5 * np.pi / CORNER_STEPS])
    sides = [LENGTH_STEPS, WIDTH_STEPS, LENGTH_STEPS, WIDTH_STEPS]
    return [motion for side in sides for motion in [ahead] * side + [turn] * CORNER_STEPS]
