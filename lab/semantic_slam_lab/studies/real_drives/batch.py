"""The reference with landmark numbers given: all keyframes at once, with a robust kernel on the detections."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import gtsam
import numpy as np

from semantic_slam.configuration import Configuration
from semantic_slam.evaluation.record import Record
from semantic_slam.evaluation.trajectory import Trajectory
from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import planar_from_covariance, planar_from_pose_vector
from semantic_slam.geometry.transform import between
from semantic_slam.inference.inputs.keyframe import OdometrySample
from semantic_slam.inference.models.noise.configured_noise import ConfiguredNoise
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.pipeline.odometry.motion import OdometryPoint, motion_covariance, point_between, start

CAUCHY = 2.3849
"""Width of the kernel, in standard deviations: 95 % efficient where errors are Gaussian (Holland, Welsch 1977)."""
MOST_ITERATIONS = 200


@dataclass(frozen=True)
class Solution:
    """K keyframes and L landmarks at the optimum."""

    path: Array  # (K, 3)
    landmarks: dict[str, Array]  # number -> (2,)


def batch_cauchy(record: Record, configuration: Configuration, detection_factor: float) -> Solution:
    """Minimise over the keyframes of ``record`` and the landmarks that its detections name, from dead reckoning.

    ``detection_factor`` scales the covariances of the detections; none of the ``configuration``'s own is looked at.
    """
    points = points_at(record.odometry, [belief.stamp_ns for belief in record.beliefs])
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    pose = np.array(configuration.initial_pose.mean)
    anchor = gtsam.noiseModel.Diagonal.Sigmas(np.array(configuration.initial_pose.sigma))
    graph.add(gtsam.PriorFactorPose2(_robot(-1), gtsam.Pose2(*pose), anchor))
    values.insert(_robot(-1), gtsam.Pose2(*pose))
    keys: dict[str, int] = {}
    stated = ConfiguredNoise(configuration.odometry, configuration.perception)
    for k, (before, after) in enumerate(pairwise(points)):
        control = planar_from_pose_vector(between(before.pose, after.pose))
        covariance = planar_from_covariance(motion_covariance(before, after, configuration.odometry))
        noise = gtsam.noiseModel.Gaussian.Covariance(covariance)
        graph.add(gtsam.BetweenFactorPose2(_robot(k - 1), _robot(k), gtsam.Pose2(*control), noise))
        pose = se2.compose(pose, control)
        values.insert(_robot(k), gtsam.Pose2(*pose))
        seen = record.measurements[record.beliefs[k].stamp_ns]
        covariances = detection_factor * stated.of_detections(seen.ranges_m, seen.geometric_covariances)
        _add_detections(graph, values, keys, k, gtsam.Pose2(*pose), seen, covariances)
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setMaxIterations(MOST_ITERATIONS)
    found = gtsam.LevenbergMarquardtOptimizer(graph, values, parameters).optimize()
    poses = [found.atPose2(_robot(k)) for k in range(len(record.beliefs))]
    path = np.array([[own.x(), own.y(), own.theta()] for own in poses])
    return Solution(path, {name: np.asarray(found.atPoint2(key)) for name, key in keys.items()})


def points_at(odometry: Trajectory, stamps_ns: Sequence[int]) -> list[OdometryPoint]:
    """The first point of ``odometry``, then those at each stamp, interpolated; the last one stands for all after it."""
    samples = [OdometrySample(int(stamp), pose) for stamp, pose in zip(odometry.stamps_ns, odometry.poses, strict=True)]
    points = [start(samples[0])]
    for sample in samples[1:]:
        points.append(points[-1].advance(sample))
    found = [points[0]]
    for stamp_ns in stamps_ns:
        after = int(np.searchsorted(odometry.stamps_ns, stamp_ns))
        if after in (0, len(points)):
            found.append(points[min(after, len(points) - 1)])
        else:
            found.append(point_between(points[after - 1], points[after], stamp_ns))
    return found


def _add_detections(
    graph: gtsam.NonlinearFactorGraph,
    values: gtsam.Values,
    keys: dict[str, int],
    k: int,
    pose: gtsam.Pose2,
    seen: SemanticMeasurements,
    covariances: Array,
) -> None:
    """The detections of keyframe ``k`` that carry a number; a new number starts where ``pose`` sees it first.

    ``covariances`` (D, 2, 2) of [range, bearing].
    """
    kernel = gtsam.noiseModel.mEstimator.Cauchy.Create(CAUCHY)
    for row, name in enumerate(seen.track_ids):
        if not name:
            continue
        distance, bearing = float(seen.ranges_m[row]), gtsam.Rot2.fromAngle(float(seen.bearings_rad[row]))
        if name not in keys:
            keys[name] = int(gtsam.symbol("l", len(keys)))
            values.insert(keys[name], pose.transformFrom(bearing.rotate(np.array([distance, 0.0]))))
        spread = gtsam.noiseModel.Gaussian.Covariance(covariances[row][::-1, ::-1])
        robust = gtsam.noiseModel.Robust.Create(kernel, spread)
        graph.add(gtsam.BearingRangeFactor2D(_robot(k), keys[name], bearing, distance, robust))


def _robot(keyframe: int) -> int:
    """GTSAM key of a keyframe's pose; -1 is the start of the drive."""
    return int(gtsam.symbol("x", keyframe + 1))
