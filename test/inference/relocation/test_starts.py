"""Starts of a lost robot: a stand-in at a point of a lattice weighs what the wide prior does."""

import numpy as np
import pytest
from worlds.scenes.lost_world import configuration, make_world, map_of

from semantic_slam import Engine
from semantic_slam.geometry import se2
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.inference.kept_steps import KeptSteps
from semantic_slam.inference.revision.replay import Replay
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.lineage import LineageStep
from semantic_slam.inference.world.starts import ANYWHERE, Starts

TRIANGLE = np.array([[3.0, 1.0], [6.0, 2.0], [1.0, 3.0]])
WIDE = Starts(np.array([1.0, -2.0, 0.7]), np.diag([10.0, 8.0, 3.14]) ** 2)


def test_every_start_is_the_one_that_is_nearest_to_its_own_pose() -> None:
    random = np.random.default_rng(0)
    poses = WIDE.mean + random.normal(size=(200, 3)) * [10.0, 8.0, 3.14]
    for pose in poses:
        number = WIDE.number(pose)
        assert number is not None
        assert number != ANYWHERE
        assert WIDE.number(WIDE.pose(number)) == number
        offset = WIDE.pose(number) - pose
        offset[2] = wrap_angle(offset[2])
        assert (np.abs(offset) <= [0.1251, 0.1251, 0.0376]).all()


def test_beyond_six_standard_deviations_there_are_none() -> None:
    assert WIDE.number(WIDE.mean + np.array([61.0, 0.0, 0.0])) is None


def test_what_is_known_well_has_its_prior_and_no_lattice() -> None:
    starts = Starts(np.zeros(3), np.diag([10.0, 10.0, 0.1]) ** 2)
    number = starts.number(np.array([3.0, 4.0, 0.02]))
    assert number is not None
    np.testing.assert_allclose(starts.pose(number)[2], 0.0, atol=1e-12)
    np.testing.assert_allclose(starts.prior(number).covariance[2, 2], 0.01)


def test_a_robot_that_knows_roughly_where_it_begins_is_not_lost() -> None:
    assert Starts.of(GaussianPrior(np.zeros(3), np.diag([0.5, 0.5, 0.1]) ** 2)) is None
    assert Starts.of(GaussianPrior(np.zeros(3), np.diag([0.5, 0.5, 1.0]) ** 2)) is not None


def test_a_start_beside_one_that_is_taken_is_that_one() -> None:
    number = WIDE.number(np.array([3.0, 4.0, 1.0]))
    assert number is not None
    beside = WIDE.pose(number) + np.array([0.2, -0.2, 0.05])
    assert WIDE.number(beside) != number
    assert WIDE.nearest(beside, {ANYWHERE, number}) == number
    assert WIDE.nearest(beside, {ANYWHERE}) == WIDE.number(beside)


def test_moments_in_map_are_those_of_samples() -> None:
    starts = Starts(np.array([1.0, 2.0, 0.4]), np.array([[2.0, 0.3, 0.2], [0.3, 1.0, -0.1], [0.2, -0.1, 0.5]]))
    state, covariance = np.array([4.0, 3.0, -0.5]), np.array([[0.3, 0.1, 0.05], [0.1, 0.2, 0.0], [0.05, 0.0, 0.1]])
    random = np.random.default_rng(1)
    own = random.multivariate_normal(state, covariance, 400_000)
    shift = random.multivariate_normal(np.zeros(3), starts.covariance, 400_000)
    arm, turn = own[:, :2] - starts.mean[:2], shift[:, 2]
    x = starts.mean[0] + shift[:, 0] + np.cos(turn) * arm[:, 0] - np.sin(turn) * arm[:, 1]
    y = starts.mean[1] + shift[:, 1] + np.sin(turn) * arm[:, 0] + np.cos(turn) * arm[:, 1]
    samples = np.column_stack([x, y, own[:, 2] + turn])
    mean, spread = starts.in_map(state[None], covariance[None])
    np.testing.assert_allclose(mean[0], samples.mean(axis=0), atol=0.02)
    np.testing.assert_allclose(spread[0], np.cov(samples.T), atol=0.05)


def test_a_history_weighs_what_the_integral_over_all_initial_poses_does() -> None:
    """One keyframe, three points of the map: P(Z) = sum over a grid of x0 of p(x0) E[likelihood over the motion]."""
    start = np.array([4.0, -3.0, 2.0])
    world = make_world(start, 1, places=TRIANGLE, seed=3)
    (keyframe,), (names,) = world.keyframes, world.names
    assert len(names) == 3
    engine = Engine(configuration(rates={"birth_density": 1e-9, "clutter_per_frame": 0.0}), map_of(TRIANGLE))
    starts = engine.problem.starts
    assert starts is not None
    step = engine.problem.reader.step(keyframe)
    association = engine.association(engine.problem, engine.registry)
    association.introduce(engine.registry, step)
    replay = Replay(engine.problem, association, KeptSteps([step]))
    number = starts.number(start)
    assert number is not None
    lineage = (LineageStep(names, (-1, -1, -1), engine.problem.with_start(0, number)),)
    found = replay.followed(lineage)
    assert found is not None
    expected = _by_grid(engine, step, start, TRIANGLE[list(names)])
    assert found.log_joint - _detected(3) == pytest.approx(expected, abs=0.1)


def _detected(count: int) -> float:
    """Log probability that all of ``count`` objects are detected."""
    return count * float(np.log(0.9))


def _by_grid(engine: Engine, step: object, start: np.ndarray, places: np.ndarray) -> float:
    """Log of the integral over x0 and the motion, of the density of range and bearing of each place."""
    random = np.random.default_rng(0)
    motions = random.multivariate_normal(np.zeros(3), step.motion.covariance, 200)
    axes = [np.linspace(-w, w, n) for w, n in ((0.35, 21), (0.35, 21), (0.12, 21))]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3) + start
    volume = float(np.prod([axis[1] - axis[0] for axis in axes]))
    total = np.full(len(grid), -np.inf)
    for motion in motions:
        x = se2.compose(grid, se2.compose(step.motion.control, se2.exp(motion)))
        total = np.logaddexp(total, _log_likelihood(x, step.detections, places))
    total += engine.problem.starts.log_density(grid) - np.log(len(motions))
    return float(np.logaddexp.reduce(total) + np.log(volume))


def _log_likelihood(x: np.ndarray, detections: list[object], places: np.ndarray) -> np.ndarray:
    found = np.zeros(len(x))
    for detection, place in zip(detections, places, strict=True):
        offset = place - x[:, :2]
        off_range = detection.range_m - np.hypot(*offset.T)
        off_bearing = wrap_angle(detection.bearing_rad - np.arctan2(offset[:, 1], offset[:, 0]) + x[:, 2])
        variances = np.diag(detection.covariance) + np.array([1e-4, 0.0])  # a point of the map is known to a centimetre
        found += -0.5 * (off_range**2 / variances[0] + off_bearing**2 / variances[1])
        found -= 0.5 * np.log((2.0 * np.pi) ** 2 * variances.prod())
    return found
