"""The first keyframes of Victoria Park with known association, against GTSAM's batch solution of the same problem."""

import json
import sys
from pathlib import Path

import gtsam
import numpy as np
import pytest
from worlds.bags.imported import run_import

from semantic_slam.bag.reader import BagReader
from semantic_slam.cli import bag_to_report
from semantic_slam.configuration import load_configuration
from semantic_slam.datasets.victoria_park import dead_reckoning, example_path, range_bearing, read_log
from semantic_slam.geometry.pose import planar_from_covariance, planar_from_pose_vector
from semantic_slam.messages.codec import from_message
from semantic_slam.messages.topics import BELIEF

CONFIGURATION = Path(__file__).parents[2] / "config" / "victoria_park.yaml"
NUM_KEYFRAMES = 120
VARIANCE_M2 = 0.4
START = gtsam.symbol("s", 0)


def beliefs_of(folder):
    with BagReader(folder) as reader:
        return [from_message(reader.decode(m.cdr, m.type_name)) for m in reader.messages([BELIEF])]


def motion_noise(settings, increments):
    """Variances of floor, path length and turning add up over the increments between two keyframes."""
    travelled, turned = np.hypot(increments[:, 0], increments[:, 1]).sum(), np.abs(increments[:, 2]).sum()
    translation = settings.sigma_translation_floor_m**2 + (settings.sigma_translation_per_m * travelled) ** 2
    per_m, per_rad = settings.sigma_rotation_per_m * travelled, settings.sigma_rotation_per_rad * turned
    rotation = settings.sigma_rotation_floor_rad**2 + per_m**2 + per_rad**2
    return gtsam.noiseModel.Diagonal.Variances(np.array([translation, translation, rotation]))


def batch_solution(log, configuration):
    """Poses at the keyframes (K, 3), landmarks by name, and the covariance of the last pose in its own frame."""
    seen = log.by_pose()
    keyframes = [index for index, observations in enumerate(seen) if observations][:NUM_KEYFRAMES]
    odometry = [gtsam.Pose2(*pose) for pose in dead_reckoning(log.increments)]
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    start = gtsam.noiseModel.Diagonal.Sigmas(np.array(configuration.initial_pose.sigma))
    graph.add(gtsam.PriorFactorPose2(START, gtsam.Pose2(), start))
    values.insert(START, gtsam.Pose2())
    previous, last = START, 0
    for k, index in enumerate(keyframes):
        key = gtsam.symbol("x", k)
        noise = motion_noise(configuration.odometry, log.increments[last:index])
        graph.add(gtsam.BetweenFactorPose2(previous, key, odometry[last].between(odometry[index]), noise))
        values.insert(key, odometry[index])
        for observation in seen[index]:
            landmark = gtsam.symbol("l", int(observation.landmark))
            if not values.exists(landmark):
                values.insert(landmark, odometry[index].transformFrom(observation.position))
            ranges, bearings, covariances = range_bearing(observation.position[None], VARIANCE_M2)
            noise = gtsam.noiseModel.Gaussian.Covariance(covariances[0][::-1, ::-1])
            graph.add(gtsam.BearingRangeFactor2D(key, landmark, gtsam.Rot2(bearings[0]), ranges[0], noise))
        previous, last = key, index
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setRelativeErrorTol(1e-12)
    result = gtsam.LevenbergMarquardtOptimizer(graph, values, parameters).optimize()
    names = {item.landmark for index in keyframes for item in seen[index]}
    landmarks = {name: np.asarray(result.atPoint2(gtsam.symbol("l", int(name)))) for name in names}
    pose = result.atPose2(previous)
    return (
        np.array([pose.x(), pose.y(), pose.theta()]),
        landmarks,
        gtsam.Marginals(graph, result).marginalCovariance(previous),
    )


@pytest.mark.long
@pytest.mark.slow
def test_first_keyframes_replay_report_and_agree_with_the_batch_solution(tmp_path, monkeypatch):
    bag, out = tmp_path / "bag", tmp_path / "out"
    run_import(monkeypatch, "victoria_park", "--out", bag)
    words = ("bag_to_report", bag, "--out", out, "--config", CONFIGURATION, "--max-keyframes", NUM_KEYFRAMES)
    monkeypatch.setattr(sys, "argv", [str(word) for word in words])
    bag_to_report.command()

    report = json.loads((out / "report.json").read_text())
    assert report["bag"]["n_keyframes"] == NUM_KEYFRAMES
    assert report["metrics"]["association_f1"] == 1.0
    assert (out / "report.html").stat().st_size > 10_000

    final = beliefs_of(out / "belief")[-1]
    pose, landmarks, covariance = batch_solution(read_log(example_path()), load_configuration(CONFIGURATION))
    # The engine is incremental and gives new landmarks a prior of 1 km: a millimetre, where a sigma is decimetres.
    np.testing.assert_allclose(planar_from_pose_vector(final.poses[0]), pose, atol=1e-3)
    assert set(final.object_names) == landmarks.keys()
    expected = np.array([landmarks[name] for name in final.object_names])
    np.testing.assert_allclose(final.object_poses[:, :2], expected, atol=2e-3)
    turn = np.eye(3)
    turn[:2, :2] = gtsam.Rot2(pose[2]).matrix()
    in_map = turn @ covariance @ turn.T
    np.testing.assert_allclose(planar_from_covariance(final.pose_covariances[0]), in_map, atol=0.01 * in_map.max())
