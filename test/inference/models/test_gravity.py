"""Looks at gravity: roll and pitch of a robot in space, without yaw and place."""

import gtsam
import numpy as np
import pytest
from scipy.stats import chi2

from semantic_slam import Configuration, Detection, Engine, InputError, Keyframe
from semantic_slam.geometry import se3, so3
from semantic_slam.inference.association.strategy import strategy_of
from semantic_slam.inference.building.spatial_checks import check_space
from semantic_slam.inference.models.spatial.gravity import Gravity
from semantic_slam.inference.states.kinds.spatial_poses import SpatialPoses

SPACE = SpatialPoses()
TILTED = np.append([1.0, -2.0, 0.5], so3.exp(np.array([0.3, -0.2, 1.1])))
ORIGIN = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
SIGMA = 0.02


def up_of(pose: np.ndarray) -> np.ndarray:
    """Direction of up along the axes of a body at a pose (7,)."""
    return so3.matrix(pose[3:])[2]


def look(off: np.ndarray) -> Gravity:
    """At gravity, by a body that is off by a turn (3,) from where it is taken to be."""
    return Gravity(up_of(se3.retract(TILTED, np.append(off, np.zeros(3)))), SIGMA**2)


def test_slopes_are_those_of_the_residual() -> None:
    gravity, steps = look(np.array([0.02, 0.01, 0.0])), 1e-6 * np.eye(6)
    ahead = np.array([gravity.residual(SPACE.retract(TILTED, step))[0] for step in steps])
    behind = np.array([gravity.residual(SPACE.retract(TILTED, -step))[0] for step in steps])
    np.testing.assert_allclose(gravity.residual(TILTED)[1], (ahead - behind).T / 2e-6, atol=1e-8)


def test_a_turn_about_the_vertical_and_a_place_are_not_felt() -> None:
    gravity = look(np.zeros(3))
    np.testing.assert_allclose(gravity.residual(TILTED)[1] @ SPACE.vertical(TILTED), 0.0, atol=1e-12)
    np.testing.assert_allclose(gravity.residual(TILTED)[0], 0.0, atol=1e-12)


def test_the_factor_and_the_prediction_agree_on_the_posterior() -> None:
    """GTSAM's optimum and marginal with the factor are those of one linear look, to second order in the angles."""
    off, spread = np.array([0.01, -0.02, 0.0]), np.diag([0.03, 0.02, 0.02, 0.1, 0.1, 0.1]) ** 2
    gravity, graph, values = look(off), gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.add(SPACE.prior_factors(0, TILTED, spread)[0])
    graph.add(gravity.factor(0))
    SPACE.insert(values, 0, TILTED)
    optimum = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    level = gravity.levels(TILTED, spread)
    np.testing.assert_allclose(SPACE.local(TILTED, SPACE.state(optimum, 0)), level.shift, atol=5e-4)
    marginal = gtsam.Marginals(graph, optimum).marginalCovariance(0)
    np.testing.assert_allclose(np.sqrt(np.diagonal(marginal)), np.sqrt(np.diagonal(level.covariance)), rtol=2e-2)


def test_the_evidence_of_a_look_at_gravity_is_its_predicted_density() -> None:
    """Against the mean of its density over a million draws of the robot."""
    off, sigmas = np.array([0.02, -0.03, 0.0]), np.array([0.03, 0.02, 0.02, 0.1, 0.1, 0.1])
    gravity, random = look(off), np.random.default_rng(3)
    turns = so3.product(TILTED[3:], so3.exp(random.normal(size=(1_000_000, 3)) * sigmas[:3]))
    aside = gtsam.Unit3(gravity.up).basis()
    squared = ((so3.matrix(turns)[:, 2] @ aside) ** 2).sum(axis=1) / gravity.variance
    sampled = np.log(np.mean(np.exp(-0.5 * squared) / (2.0 * np.pi * gravity.variance)))
    assert gravity.levels(TILTED, np.diag(sigmas**2)).log_evidence == pytest.approx(sampled, abs=0.01)


@pytest.mark.long
def test_at_its_mode_the_evidence_holds_for_a_body_that_leans_far() -> None:
    """To a twentieth of a nat, where one linear look is off by a fifth."""
    off, sigmas = np.array([0.5, -0.4, 0.0]), np.array([0.3, 0.3, 0.3, 0.1, 0.1, 0.1])
    gravity, random = look(off), np.random.default_rng(4)
    turns = so3.product(TILTED[3:], so3.exp(random.normal(size=(4_000_000, 3)) * sigmas[:3]))
    robots = np.append(np.zeros((len(turns), 3)), turns, axis=1)
    sampled = float(np.log(np.mean(np.exp(gravity.log_likelihood(robots)))))
    assert gravity.at_mode(TILTED, np.diag(sigmas**2)).log_evidence == pytest.approx(sampled, abs=0.05)
    assert abs(gravity.levels(TILTED, np.diag(sigmas**2)).log_evidence - sampled) > 0.2


DRIFT = np.array([0.02, 0.02, 0.01, 0.02, 0.02, 0.02])
"""Of odometry that does not hold roll and pitch, [rotation, translation]."""


def engine_at(start: np.ndarray) -> Engine:
    """Of a robot without a map that knows its pose (7,) to a centimetre and half a degree."""
    return Engine(
        Configuration.of(
            state_space="spatial",
            observation="points",
            association="open",
            semantic_model={"kind": "none"},
            open_world={"birth_density": 0.3, "detection_probability": 0.95},
            pruning={"max_hypotheses": 4},
        ),
        initial_pose=start,
        initial_covariance=1e-4 * np.eye(6),
    )


def test_the_evidence_of_a_keyframe_counts_what_gravity_tells() -> None:
    start, spread = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]), np.diag(DRIFT**2)
    felt = so3.rotated(so3.exp(np.array([0.03, -0.05, 0.0])), np.array([0.0, 0.0, 1.0]))
    evidence = []
    for told in ({}, {"up": felt, "sigma_up_rad": SIGMA}):
        engine = engine_at(start)
        engine.process(Keyframe.spatial(0, motion_covariance=se3.covariance_along_parent(ORIGIN, spread), **told))
        evidence.append(engine.log_evidence)
    level = Gravity(felt, SIGMA**2).levels(start, 1e-4 * np.eye(6) + spread)
    assert evidence[1] - evidence[0] == pytest.approx(level.log_evidence, abs=1e-5)


def flown(seed: int, *, feels: bool) -> tuple[np.ndarray, np.ndarray]:
    """Errors [rotation, translation] of the last of 12 poses, and their covariance."""
    random, start = np.random.default_rng(seed), np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
    engine = engine_at(start)
    x, point = start, np.array([6.0, 0.0, 1.0])
    for k in range(12):
        motion = np.append([0.1, 0.0, 0.0], so3.exp(np.array([0.0, 0.0, 0.02])))
        x = se3.retract(se3.compose(x, motion), random.normal(size=6) * DRIFT)
        away = so3.rotated(so3.inverse(x[3:]), point - x[:3])
        distance = float(np.linalg.norm(away))
        seen = Detection.along(
            away / distance + 0.01 * random.normal(size=3),
            distance + 0.05 * random.normal(),
            sigma_range_m=0.05,
            ray_covariance=1e-4 * np.eye(3),
        )
        felt = up_of(se3.retract(x, np.append(SIGMA * random.normal(size=3), np.zeros(3))))
        told = {"up": felt, "sigma_up_rad": SIGMA} if feels else {}
        spread = se3.covariance_along_parent(ORIGIN, np.diag(DRIFT**2))
        keyframe = Keyframe.spatial(k, motion=motion, motion_covariance=spread, detections=[seen], **told)
        belief = engine.process(keyframe)
    error = se3.log(se3.between(belief.poses[0], x))
    return error, se3.covariance_at_pose(belief.poses[0], belief.pose_covariances[0])


@pytest.mark.long
def test_roll_and_pitch_do_not_drift_where_gravity_is_felt() -> None:
    """And the belief is as sure of them as it is right: the mean normalised error of 8 flights is that of two."""
    tilts, spreads = [], []
    for seed in range(8):
        error, spread = flown(seed, feels=True)
        tilts.append(error[:2] @ np.linalg.solve(spread[:2, :2], error[:2]))
        spreads.append(np.sqrt(np.diagonal(spread)[:2]).max())
    assert max(spreads) < SIGMA
    low, high = chi2.interval(0.99, 2 * len(tilts))
    assert low < np.sum(tilts) < high
    _, blind = flown(0, feels=False)
    assert np.sqrt(np.diagonal(blind)[:2]).max() > 1.5 * max(spreads)


def test_a_direction_that_is_none_is_refused() -> None:
    with pytest.raises(InputError, match="give the direction against gravity as x, y, z"):
        Keyframe.spatial(0, up=[0.0, 0.0, 0.0])
    with pytest.raises(InputError, match="a standard deviation must be above 0"):
        Keyframe.spatial(0, up=[0.0, 0.0, 1.0], sigma_up_rad=0.0)


def told_level_by_odometry(**settings: str) -> Configuration:
    """Of a run whose odometry holds roll and pitch."""
    return Configuration.of(semantic_model={"kind": "none"}, odometry={"sigma_level_rad": 0.02}, **settings)


def test_where_gravity_has_no_say_the_configuration_is_refused() -> None:
    configuration = told_level_by_odometry(association="given")
    with pytest.raises(InputError, match="set it to 0, or state_space: spatial"):
        check_space(configuration, strategy_of(configuration))


@pytest.mark.parametrize("association", ["enumerated", "given", "open"])
def test_levelled_odometry_serves_every_association_in_space(association: str) -> None:
    configuration = told_level_by_odometry(association=association, state_space="spatial", observation="points")
    check_space(configuration, strategy_of(configuration))
