"""The solution of Victoria Park with the file's landmark numbers known, under the same noise."""

import time
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import gtsam
import numpy as np
from numpy.typing import NDArray

from semantic_slam.datasets.victoria_park import range_bearing
from semantic_slam.inference.odometry_bias import BIAS_KEY, BIAS_LETTER, bias_prior, biased_factor
from semantic_slam.studies.victoria_park_data import Drive

Array = NDArray[np.float64]

ANCHOR_SIGMAS = np.array([0.01, 0.01, 0.001])
"""Of the pose at the start of the drive, which fixes the gauge: metres, metres, radians."""


@dataclass(frozen=True)
class Solution:
    """Minimum of half the sum of squared whitened residuals of odometry, detections and the anchor."""

    poses: Array  # (K, 3) keyframes
    cost: float
    bias: Array  # (2,) of odometry: heading [rad/m] and length; none where it is not a variable
    seconds: float = 0.0  # of the thread for the incremental part: what any method pays on this machine


def known_association(drive: Drive, variance_m2: float, bias_sigmas: Array) -> Solution:
    """Incremental first, for a search from dead reckoning ends in a wrong minimum, then Levenberg-Marquardt."""
    problem = _Problem(drive, drive.labels, variance_m2, bias_sigmas)
    isam = gtsam.ISAM2(_parameters(len(bias_sigmas)))
    isam.update(problem.graph, problem.start())
    known: set[Hashable] = set()
    begin = time.thread_time()
    for k in range(len(drive.keyframes)):
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        before = isam.calculateEstimate([_pose(k - 1)]).atPose2(_pose(k - 1))
        bias = isam.calculateEstimateVector(BIAS_KEY) if len(bias_sigmas) else np.zeros(0)
        problem.add(graph, values, k, before.compose(problem.control(k, bias)), known)
        isam.update(graph, values)
    seconds = time.thread_time() - begin
    return replace(problem.optimised(isam.calculateEstimate()), seconds=seconds)


def from_poses(
    drive: Drive, clusters: Sequence[tuple[Hashable, ...]], variance_m2: float, bias_sigmas: Array, poses: Array
) -> Solution:
    """The minimum near ``poses`` (K, 3) with detections associated as ``clusters`` says."""
    problem = _Problem(drive, clusters, variance_m2, bias_sigmas)
    values = problem.start()
    known: set[Hashable] = set()
    for k, pose in enumerate(poses):
        problem.add(gtsam.NonlinearFactorGraph(), values, k, gtsam.Pose2(*pose), known)
    return problem.optimised(values)


def rms_distance(poses: Array, reference: Array) -> float:
    """Root mean square over keyframes of the distance of positions, nothing aligned: both hang on the same anchor."""
    return float(np.sqrt(((poses[:, :2] - reference[: len(poses), :2]) ** 2).sum(axis=1).mean()))


class _Problem:
    """``bias_sigmas`` (2,): odometry's biases are a variable, with these standard deviations; none: they are not."""

    def __init__(
        self, drive: Drive, clusters: Sequence[tuple[Hashable, ...]], variance_m2: float, bias_sigmas: Array
    ):
        self.drive, self.clusters, self.variance_m2, self.bias_sigmas = drive, clusters, variance_m2, bias_sigmas
        names = dict.fromkeys(name for own in clusters for name in own)
        self.keys = {name: gtsam.symbol("l", number) for number, name in enumerate(names)}
        self.graph = bias_prior(len(bias_sigmas))[0] if len(bias_sigmas) else gtsam.NonlinearFactorGraph()
        noise = gtsam.noiseModel.Diagonal.Sigmas(ANCHOR_SIGMAS)
        self.graph.add(gtsam.PriorFactorPose2(_pose(-1), gtsam.Pose2(), noise))
        self.num_keyframes = 0

    def start(self) -> gtsam.Values:
        """Before any keyframe."""
        values = bias_prior(len(self.bias_sigmas))[1] if len(self.bias_sigmas) else gtsam.Values()
        values.insert(_pose(-1), gtsam.Pose2())
        return values

    def by_bias(self, k: int) -> Array:
        """(3, 2) of the motion to keyframe ``k``."""
        return np.asarray(self.drive.keyframes[k].odometry_slopes * self.bias_sigmas)

    def control(self, k: int, bias: Array) -> gtsam.Pose2:
        """The motion to keyframe ``k`` without odometry's biases."""
        control = gtsam.Pose2(*self.drive.controls[k])
        return control.retract(self.by_bias(k) @ bias) if len(bias) else control

    def odometry(self, k: int) -> Any:
        keys, control, covariance = (_pose(k - 1), _pose(k)), self.drive.controls[k], self.drive.covariances[k]
        if len(self.bias_sigmas):
            return biased_factor(keys, control, covariance, self.by_bias(k))
        noise = gtsam.noiseModel.Gaussian.Covariance(covariance)
        return gtsam.BetweenFactorPose2(*keys, gtsam.Pose2(*control), noise)

    def add(
        self, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, k: int, pose: gtsam.Pose2, known: set[Hashable]
    ) -> None:
        """Factors and first values of keyframe ``k`` to ``graph`` and ``values``, and the factors to the whole."""
        factors = [self.odometry(k)]
        values.insert(_pose(k), pose)
        positions = self.drive.positions[k]
        ranges, bearings, covariances = range_bearing(positions, self.variance_m2)
        for number, name in enumerate(self.clusters[k]):
            if name not in known:
                known.add(name)
                values.insert(self.keys[name], pose.transformFrom(positions[number]))
            noise = gtsam.noiseModel.Gaussian.Covariance(covariances[number][::-1, ::-1])
            bearing = gtsam.Rot2.fromAngle(bearings[number])
            factors.append(gtsam.BearingRangeFactor2D(_pose(k), self.keys[name], bearing, ranges[number], noise))
        for factor in factors:
            graph.add(factor)
            self.graph.add(factor)
        self.num_keyframes = k + 1

    def optimised(self, values: gtsam.Values) -> Solution:
        optimum = gtsam.LevenbergMarquardtOptimizer(self.graph, values).optimize()
        poses = [optimum.atPose2(_pose(k)) for k in range(self.num_keyframes)]
        bias = optimum.atVector(BIAS_KEY) * self.bias_sigmas if len(self.bias_sigmas) else np.zeros(0)
        return Solution(np.array([[p.x(), p.y(), p.theta()] for p in poses]), float(self.graph.error(optimum)), bias)


def _pose(keyframe: int) -> int:
    """-1: the start of the drive."""
    return int(gtsam.symbol("x", keyframe + 1))


def _parameters(num_biases: int) -> gtsam.ISAM2Params:
    parameters = gtsam.ISAM2Params()
    parameters.relinearizeSkip = 1
    thresholds = gtsam.ISAM2ThresholdMap()
    for symbol, limits in {"x": [0.1] * 3, "l": [0.1] * 2, BIAS_LETTER: [np.inf] * num_biases}.items():
        thresholds.insert((symbol, np.array(limits)))
    parameters.setRelinearizeThreshold(thresholds)
    return parameters
