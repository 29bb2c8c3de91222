"""A smoother with one update per keyframe, where it holds its factors linearised: against the optimum of them all."""

import gtsam
import numpy as np
import pytest

from semantic_slam.geometry import se2
from semantic_slam.inference.models.planar_observation import PlanarObservation
from semantic_slam.inference.models.visibility import PlanarVisibility
from semantic_slam.inference.smoothing.semantic_factors import SemanticFactorMaker
from semantic_slam.inference.smoothing.smoother import Smoother
from semantic_slam.inference.states.keys import object_key, robot_key
from semantic_slam.inference.states.planar_poses import PlanarPoses
from semantic_slam.inference.states.spaces import Spaces

SPACES = Spaces.same(PlanarPoses())
MAKER = SemanticFactorMaker(SPACES, PlanarObservation(None, PlanarVisibility()), None)
KEYFRAMES = 40
STEP = np.array([0.5, 0.0, 2.0 * np.pi / KEYFRAMES])
STEP_NOISE = gtsam.noiseModel.Diagonal.Sigmas(np.array([0.05, 0.05, 0.03]))
PLACE_NOISE = gtsam.noiseModel.Diagonal.Sigmas(np.array([0.02, 0.05]))
LOOSE = gtsam.noiseModel.Isotropic.Sigma(3, 10.0)
POSTS = np.array([[1.5, 1.0], [2.0, -0.8]])


def on_a_ring(drift_rad: float) -> Smoother:
    """Once around, the odometry turning by so much too much in all; two posts are seen at the start and at the end."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.add(gtsam.PriorFactorPose2(robot_key(-1), gtsam.Pose2(), gtsam.noiseModel.Isotropic.Sigma(3, 1e-3)))
    values.insert(robot_key(-1), gtsam.Pose2())
    smoother = Smoother.of(SPACES, MAKER, graph, values).with_single_steps(0, errors_repeat=True)
    true = np.zeros(3)
    for k in range(KEYFRAMES + 3):
        true = se2.compose(true, STEP)
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        told = gtsam.Pose2(*(STEP + np.array([0.0, 0.0, drift_rad / KEYFRAMES])))
        graph.add(gtsam.BetweenFactorPose2(robot_key(k - 1), robot_key(k), told, STEP_NOISE))
        robot = smoother.isam.calculateEstimatePose2(robot_key(k - 1)).compose(told)
        values.insert(robot_key(k), robot)
        for number in range(len(POSTS)) if k < 3 or k >= KEYFRAMES else ():
            x, y = se2.between(true, np.array([*POSTS[number], 0.0]))[:2]
            reach, bearing = float(np.hypot(x, y)), gtsam.Rot2(float(np.arctan2(y, x)))
            graph.add(gtsam.BearingRangeFactorPose2(robot_key(k), object_key(number), bearing, reach, PLACE_NOISE))
            if k == 0:
                start = gtsam.Pose2(*robot.transformFrom(np.array([x, y])), 0.0)
                graph.add(gtsam.PriorFactorPose2(object_key(number), start, LOOSE))
                values.insert(object_key(number), start)
        smoother = smoother.stepped(graph, values, [], {}, again=k == KEYFRAMES)
    return smoother


def optimum(smoother: Smoother) -> gtsam.Values:
    """Of its factors as they are, wherever they were linearised."""
    factors = gtsam.NonlinearFactorGraph()
    for slot in range(smoother.exact.size()):
        if smoother.exact.exists(slot):
            factors.add(smoother.exact.at(slot))
    return gtsam.LevenbergMarquardtOptimizer(factors, smoother.isam.calculateEstimate()).optimize()


@pytest.mark.parametrize("drift_rad", [0.05, 0.5, 1.5])
def test_a_loop_that_closes_ends_at_the_optimum_of_all_factors(drift_rad: float) -> None:
    smoother = on_a_ring(drift_rad)
    best = optimum(smoother)
    keys = [robot_key(k) for k in range(KEYFRAMES + 3)]
    expected = np.array([[(pose := best.atPose2(key)).x(), pose.y(), pose.theta()] for key in keys])
    found = smoother.states(keys)
    np.testing.assert_allclose(se2.between(expected, found), 0.0, atol=0.02)


def test_a_robot_that_sees_nothing_is_linearised_anew_as_well() -> None:
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.add(gtsam.PriorFactorPose2(robot_key(-1), gtsam.Pose2(), gtsam.noiseModel.Isotropic.Sigma(3, 1e-3)))
    values.insert(robot_key(-1), gtsam.Pose2())
    smoother = Smoother.of(SPACES, MAKER, graph, values).with_single_steps(0, errors_repeat=True)
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.add(gtsam.BetweenFactorPose2(robot_key(-1), robot_key(0), gtsam.Pose2(*STEP), STEP_NOISE))
    values.insert(robot_key(0), gtsam.Pose2(1.0, 1.0, 1.0))
    smoother = smoother.stepped(graph, values, [], {}, again=True)
    np.testing.assert_allclose(smoother.states([robot_key(0)])[0], STEP, atol=1e-6)


def test_what_has_not_moved_keeps_its_factors() -> None:
    """Those at the start of the drive, which odometry alone moves little."""
    smoother = on_a_ring(0.5)
    slots = smoother.isam.getVariableIndex().at(robot_key(-1))
    assert min(slots) == 0
    assert smoother.exact.nrFactors() < smoother.exact.size()


def test_factors_are_in_the_slots_that_they_have_in_isam2() -> None:
    smoother = on_a_ring(0.5)
    held = smoother.isam.getFactorsUnsafe()
    assert held.size() == smoother.exact.size()
    for slot in range(held.size()):
        assert held.exists(slot) == smoother.exact.exists(slot)
        if held.exists(slot):
            assert list(held.at(slot).keys()) == list(smoother.exact.at(slot).keys())
