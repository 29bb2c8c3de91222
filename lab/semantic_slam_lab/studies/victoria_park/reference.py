"""The solution of Victoria Park with the file's landmark numbers known, under the same noise."""

import time
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace

import gtsam
import numpy as np

from semantic_slam.datasets.victoria_park import range_bearing
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.odometry_bias import bias_change, bias_prior, biased_factor, by_bias
from semantic_slam.inference.states.keys import begins_stretch, bias_key
from semantic_slam_lab.studies.victoria_park.data import Drive

ANCHOR_SIGMAS = np.array([0.01, 0.01, 0.001])
"""Standard deviations of the pose at the start, which fixes the gauge: metres, metres, radians."""


@dataclass(frozen=True)
class Solution:
    """Minimum of half the sum of squared whitened residuals of odometry, detections and the anchor."""

    poses: Array  # (K, 3) keyframes
    cost: float
    seconds: float = 0.0  # of the thread for the incremental part: what any method pays on this machine


def known_association(drive: Drive, variance_m2: float, bias_sigmas: Array) -> Solution:
    """Incremental first, for a search from dead reckoning ends in a wrong minimum, then Levenberg-Marquardt.

    Odometry's biases come with the latter: what the former takes is what any method pays on this machine.
    """
    problem = _Problem(drive, drive.labels, variance_m2, np.zeros(0))
    isam = gtsam.ISAM2(_parameters())
    isam.update(problem.graph, problem.values)
    known: set[Hashable] = set()
    begin = time.thread_time()
    for k in range(len(drive.keyframes)):
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        before = isam.calculateEstimate([_pose(k - 1)]).atPose2(_pose(k - 1))
        problem.add(graph, values, k, before.compose(gtsam.Pose2(*drive.controls[k])), known)
        isam.update(graph, values)
    seconds = time.thread_time() - begin
    poses = problem.poses(isam.calculateEstimate())
    return replace(from_poses(drive, drive.labels, variance_m2, bias_sigmas, poses), seconds=seconds)


def from_poses(
    drive: Drive, clusters: Sequence[tuple[Hashable, ...]], variance_m2: float, bias_sigmas: Array, poses: Array
) -> Solution:
    """The minimum near ``poses`` (K, 3) with detections associated as ``clusters`` says."""
    problem = _Problem(drive, clusters, variance_m2, bias_sigmas)
    known: set[Hashable] = set()
    for k, pose in enumerate(poses):
        problem.add(gtsam.NonlinearFactorGraph(), problem.values, k, gtsam.Pose2(*pose), known)
    optimum = gtsam.LevenbergMarquardtOptimizer(problem.graph, problem.values).optimize()
    return Solution(problem.poses(optimum), float(problem.graph.error(optimum)))


def rms_distance(poses: Array, reference: Array) -> float:
    """Root mean square over keyframes of the distance of positions, nothing aligned: both hang on the same anchor."""
    return float(np.sqrt(((poses[:, :2] - reference[: len(poses), :2]) ** 2).sum(axis=1).mean()))


class _Problem:
    """``bias_sigmas`` (3,): odometry's biases are variables, with these standard deviations; none: they are not."""

    def __init__(self, drive: Drive, clusters: Sequence[tuple[Hashable, ...]], variance_m2: float, bias_sigmas: Array):
        self.drive, self.clusters, self.variance_m2, self.bias_sigmas = drive, clusters, variance_m2, bias_sigmas
        names = dict.fromkeys(name for own in clusters for name in own)
        self.keys = {name: gtsam.symbol("l", number) for number, name in enumerate(names)}
        empty = gtsam.NonlinearFactorGraph(), gtsam.Values()
        self.graph, self.values = bias_prior(len(bias_sigmas)) if len(bias_sigmas) else empty
        noise = gtsam.noiseModel.Diagonal.Sigmas(ANCHOR_SIGMAS)
        self.graph.add(gtsam.PriorFactorPose2(_pose(-1), gtsam.Pose2(), noise))
        self.values.insert(_pose(-1), gtsam.Pose2())
        self.num_keyframes = 0

    def poses(self, values: gtsam.Values) -> Array:
        """(K, 3) planar poses of all keyframes."""
        poses = [values.atPose2(_pose(k)) for k in range(self.num_keyframes)]
        return np.array([[p.x(), p.y(), p.theta()] for p in poses])

    def _odometry(self, k: int, values: gtsam.Values) -> gtsam.NonlinearFactorGraph:
        graph, keys = gtsam.NonlinearFactorGraph(), (_pose(k - 1), _pose(k))
        control, covariance = self.drive.controls[k], self.drive.covariances[k]
        if not len(self.bias_sigmas):
            noise = gtsam.noiseModel.Gaussian.Covariance(covariance)
            graph.add(gtsam.BetweenFactorPose2(*keys, gtsam.Pose2(*control), noise))
            return graph
        if begins_stretch(k):
            bias_change(k, np.zeros(len(self.bias_sigmas)), graph, values)
        slopes = self.drive.keyframes[k].odometry_slopes
        assert slopes is not None  # the study works them out for all keyframes
        change = by_bias(slopes, self.bias_sigmas)
        graph.add(biased_factor((*keys, bias_key(k)), control, covariance, change))
        return graph

    def add(
        self, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, k: int, pose: gtsam.Pose2, known: set[Hashable]
    ) -> None:
        """Factors and first values of keyframe ``k`` to ``graph`` and ``values``, and the factors to the whole."""
        own = self._odometry(k, values)
        values.insert(_pose(k), pose)
        positions = self.drive.positions[k]
        ranges, bearings, covariances = range_bearing(positions, self.variance_m2)
        for number, name in enumerate(self.clusters[k]):
            if name not in known:
                known.add(name)
                values.insert(self.keys[name], pose.transformFrom(positions[number]))
            noise = gtsam.noiseModel.Gaussian.Covariance(covariances[number][::-1, ::-1])
            bearing = gtsam.Rot2.fromAngle(bearings[number])
            own.add(gtsam.BearingRangeFactor2D(_pose(k), self.keys[name], bearing, ranges[number], noise))
        graph.push_back(own)
        self.graph.push_back(own)
        self.num_keyframes = k + 1


def _pose(keyframe: int) -> int:
    """GTSAM key of a keyframe's pose; -1 is the start of the drive."""
    return int(gtsam.symbol("x", keyframe + 1))


def _parameters() -> gtsam.ISAM2Params:
    parameters = gtsam.ISAM2Params()
    parameters.relinearizeSkip = 1
    parameters.setRelinearizeThreshold(0.1)
    return parameters
