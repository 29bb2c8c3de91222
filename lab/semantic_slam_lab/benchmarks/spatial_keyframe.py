"""Keyframes of a hundred hypotheses in space against those in the plane, and both against bare iSAM2 of their sizes."""

import time
from dataclasses import dataclass, field

import gtsam
import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.building.problem import problem_of
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.states.keys import object_key, robot_key
from semantic_slam_lab.benchmarks.keyframe_floor import (
    DETECTIONS,
    HYPOTHESES,
    NARROW,
    POSES,
    QUICK_REPETITIONS,
    REPETITIONS,
    WIDENING,
)
from semantic_slam_lab.benchmarks.row import Row
from semantic_slam_lab.grid.hypothesis_fan import TRACKED, HypothesisFan
from semantic_slam_lab.grid.run import Setting, keyframes_of, run_of
from semantic_slam_lab.grid.world import World, grid_world

PAIRS = {
    "points": (Setting("points", False, True), Setting("points", False)),
    "bodies": (Setting(is_spatial=True), Setting()),
}
"""In space, and in the plane: places alone, and objects with headings and two classes."""


def spatial(quick: bool, seed: int) -> list[Row]:
    """Places alone, and objects with an attitude and classes."""
    repetitions = QUICK_REPETITIONS if quick else REPETITIONS
    world = grid_world(seed, num_detections=DETECTIONS, num_keyframes=POSES + repetitions, noise=TRACKED)
    return [row for name, pair in PAIRS.items() for row in _compared(name, world, pair, repetitions)]


def _compared(name: str, world: World, pair: tuple[Setting, Setting], repetitions: int) -> list[Row]:
    """All of one kind, in turn so that they meet the same machine."""
    timed = [Timed(world, setting) for setting in pair]
    for _ in range(repetitions):
        for own in timed:
            own.step()
    (space, space_floor), (plane, plane_floor) = (own.medians() for own in timed)
    by_floor = space / space_floor, plane / plane_floor
    world_of = (
        f"{HYPOTHESES} hypotheses of equal weight in and out, {DETECTIONS} detections, 6 objects, {POSES} poses;"
        f" {'two classes' if pair[0].semantics else 'geometry alone'}"
    )
    floor = "clone an ISAM2, update with odometry and built-in factors, joint marginal of 7 keys, delete"
    return [
        Row(f"spatial_{name}_vs_planar", space * 1e3, plane * 1e3, "ms", space / plane, repetitions, world_of),
        Row(
            f"spatial_{name}_vs_isam2_floor",
            space * 1e3,
            space_floor * 1e3,
            "ms",
            by_floor[0],
            repetitions,
            f"{world_of}; against {HYPOTHESES} x [{floor}] in six dimensions",
        ),
        Row(
            f"spatial_{name}_floor_vs_planar_floor",
            by_floor[0],
            by_floor[1],
            "floors",
            by_floor[0] / by_floor[1],
            repetitions,
            f"{world_of}; the ratio to that floor in space against the one in the plane",
        ),
    ]


@dataclass
class Timed:
    """A fan of hypotheses at its full width, and the floor at the same length."""

    world: World
    setting: Setting
    ours: list[float] = field(default_factory=list)
    floors: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.fan, self.floor = HypothesisFan(self.world, NARROW, self.setting), Floor(self.world, self.setting)
        self.fan.advance(POSES - WIDENING)
        self.fan.number = HYPOTHESES
        self.fan.advance(WIDENING)
        if len(self.fan) < HYPOTHESES:
            raise ValueError(f"{len(self.fan)} hypotheses instead of {HYPOTHESES}; take another seed")
        for _ in range(POSES):
            self.floor.extend()

    def step(self) -> None:
        """One keyframe of each."""
        start = time.thread_time()
        self.fan.step()
        middle = time.thread_time()
        for _ in range(HYPOTHESES):
            self.floor.child()
        self.floors.append(time.thread_time() - middle)
        self.ours.append(middle - start)
        self.floor.extend()

    def medians(self) -> tuple[float, float]:
        """Seconds of a keyframe, and of its floor."""
        return float(np.median(self.ours)), float(np.median(self.floors))


class Floor:
    """One iSAM2 of a world under its true associations, geometry alone."""

    def __init__(self, world: World, setting: Setting):
        self._problem = problem_of(run_of(world, setting))
        self._steps = [self._problem.reader.step(keyframe) for keyframe in keyframes_of(world, setting)]
        self._world, self._setting = world, setting
        parameters = gtsam.ISAM2Params()
        parameters.relinearizeSkip = 1
        self.isam = gtsam.ISAM2(parameters)
        graph, values, spaces = gtsam.NonlinearFactorGraph(), gtsam.Values(), self._problem.spaces
        priors = {object_key(own.object_id): own.prior for own in self._problem.objects}
        for key, prior in {robot_key(-1): self._problem.robot, **priors}.items():
            for factor in prior.factors(spaces.of(key), key):
                graph.add(factor)
            spaces.of(key).insert(values, key, prior.mean)
        self.isam.update(graph, values)
        self._length = 0

    def extend(self) -> None:
        """Take in a keyframe for good."""
        self.isam.update(*self._new())
        self._length += 1

    def child(self) -> Array:
        """Clone, update, joint marginal of the newest pose and all objects; the clone is deleted."""
        clone = gtsam.ISAM2(self.isam)
        clone.update(*self._new())
        keys = [robot_key(self._length), *(object_key(own.object_id) for own in self._problem.objects)]
        return np.asarray(clone.jointMarginalCovariance(keys).fullMatrix())

    def _new(self) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
        graph, values, robot = gtsam.NonlinearFactorGraph(), gtsam.Values(), self._problem.spaces.robot
        step: Step = self._steps[self._length]
        before, after = robot_key(self._length - 1), robot_key(self._length)
        graph.add(robot.between_factor(before, after, step.motion.control, step.motion.covariance))
        robot.insert(values, after, robot.compose(robot.state(self._newest(before), before), step.motion.control))
        for detection, number in zip(step.detections, self._world.frames[self._length].objects, strict=True):
            graph.add(self._problem.model.geometry_factor(detection, (after, object_key(number))))
        return graph, values

    def _newest(self, key: int) -> gtsam.Values:
        """The estimate of one robot pose alone."""
        values = gtsam.Values()
        is_spatial = self._setting.is_spatial
        values.insert(
            key, self.isam.calculateEstimatePose3(key) if is_spatial else self.isam.calculateEstimatePose2(key)
        )
        return values
