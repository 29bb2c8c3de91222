"""A keyframe of a hundred hypotheses against the least that their iSAM2 instances cost."""

import time

import gtsam
import numpy as np

from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam_lab.benchmarks.row import Row
from semantic_slam_lab.grid.hypothesis_fan import TRACKED, HypothesisFan
from semantic_slam_lab.grid.world import Frame, World, grid_world

HYPOTHESES, NARROW = 100, 1
POSES, DETECTIONS = 25, 3
WIDENING = 5
"""Keyframes before that one in which a single hypothesis becomes so many."""
REPETITIONS, QUICK_REPETITIONS = 5, 2


def floor(quick: bool, seed: int) -> list[Row]:
    """Keyframes 25 and on: expand and commit through a backend, in turn with the floor at the same length."""
    repetitions = QUICK_REPETITIONS if quick else REPETITIONS
    world = grid_world(seed, num_detections=DETECTIONS, num_keyframes=POSES + repetitions, noise=TRACKED)
    fan, least = HypothesisFan(world, NARROW), Floor(world)
    fan.advance(POSES - WIDENING)
    fan.number = HYPOTHESES
    fan.advance(WIDENING)
    if len(fan) < HYPOTHESES:
        raise ValueError(f"{len(fan)} hypotheses instead of {HYPOTHESES}; take another seed")
    for frame in world.frames[:POSES]:
        least.extend(frame)
    ours, peers, candidates = [], [], []
    for frame in world.frames[POSES:]:
        start = time.thread_time()
        candidates.append(fan.step())
        middle = time.thread_time()
        for _ in range(HYPOTHESES):
            least.child(frame)
        peers.append(time.thread_time() - middle)
        ours.append(middle - start)
        least.extend(frame)
    mine, theirs = float(np.median(ours)), float(np.median(peers))
    how = (
        f"{HYPOTHESES} hypotheses of equal weight in and out, {DETECTIONS} detections, 6 objects, two classes, {POSES}"
        f" poses, {np.median(candidates):.0f} candidates; Backend.expand and commit against {HYPOTHESES} x [clone an"
        " ISAM2, update with odometry and 3 built-in bearing-range factors, joint marginal of 7 keys, delete]"
    )
    return [Row("keyframe_vs_isam2_floor", mine * 1e3, theirs * 1e3, "ms", mine / theirs, repetitions, how)]


class Floor:
    """One iSAM2 of the world under its true associations, geometry alone."""

    def __init__(self, world: World):
        self.world = world
        self._motion = gtsam.noiseModel.Diagonal.Variances(np.array(world.noise.motion))
        self._noise = gtsam.noiseModel.Diagonal.Variances(np.array(world.noise.geometry[::-1]))
        parameters = gtsam.ISAM2Params()
        parameters.relinearizeSkip = 1
        self.isam = gtsam.ISAM2(parameters)
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        self._prior(graph, values, _robot(0), world.robot_mean, world.noise.robot)
        for i, mean in enumerate(world.object_means):
            self._prior(graph, values, _object(i), mean, world.noise.objects)
        self.isam.update(graph, values)
        self.length = 0

    def extend(self, frame: Frame) -> None:
        """Take in a frame for good."""
        self.isam.update(*self._new(frame))
        self.length += 1

    def child(self, frame: Frame) -> Array:
        """Clone, update, joint marginal of the newest pose and all objects; the clone is deleted."""
        clone = gtsam.ISAM2(self.isam)
        clone.update(*self._new(frame))
        keys = [_robot(self.length + 1), *(_object(i) for i in range(len(self.world.object_means)))]
        return np.asarray(clone.jointMarginalCovariance(keys).fullMatrix())

    def _new(self, frame: Frame) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        before, after = _robot(self.length), _robot(self.length + 1)
        graph.add(gtsam.BetweenFactorPose2(before, after, gtsam.Pose2(*frame.control), self._motion))
        pose = self.isam.calculateEstimatePose2(before)
        values.insert(after, gtsam.Pose2(*se2.compose(np.array([pose.x(), pose.y(), pose.theta()]), frame.control)))
        for (distance, bearing), number in zip(frame.geometry, frame.objects, strict=True):
            turn = gtsam.Rot2.fromAngle(bearing)
            graph.add(gtsam.BearingRangeFactorPose2(after, _object(number), turn, distance, self._noise))
        return graph, values

    def _prior(
        self,
        graph: gtsam.NonlinearFactorGraph,
        values: gtsam.Values,
        key: int,
        mean: Array,
        variances: tuple[float, ...],
    ) -> None:
        noise = gtsam.noiseModel.Diagonal.Variances(np.array(variances))
        graph.add(gtsam.PriorFactorPose2(key, gtsam.Pose2(*mean), noise))
        values.insert(key, gtsam.Pose2(*mean))


def _robot(k: int) -> int:
    return int(gtsam.symbol("x", k))


def _object(i: int) -> int:
    return int(gtsam.symbol("o", i))
