"""The metre of a map that a robot makes for itself: what is stated moves by it, away from where the robot began."""

import numpy as np
import pytest
from worlds.drives.open_room import make_room

from semantic_slam.geometry import se2
from semantic_slam.geometry.pose import planar_from_covariance, planar_from_pose_vector
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.states.metre import Metre

METRE = Metre(sigma=0.05, origin=np.array([1.0, -2.0]))
POSES = np.random.default_rng(0).uniform(-3.0, 3.0, size=(4, 3))


def scaled(states: np.ndarray, factor: float) -> np.ndarray:
    found = states.copy()
    found[:, :2] = METRE.origin + factor * (states[:, :2] - METRE.origin)
    return found


def test_a_state_moves_by_it_away_from_where_the_robot_began() -> None:
    step = 1e-6
    change = se2.log(se2.between(POSES, scaled(POSES, 1.0 + step * METRE.sigma))) / step
    np.testing.assert_allclose(METRE.slopes(POSES, 3), change, atol=1e-6)
    points = POSES[:, :2]
    np.testing.assert_allclose(METRE.slopes(points, 2), METRE.sigma * (points - METRE.origin))


def test_states_move_together() -> None:
    together = METRE.jointly_widened(POSES, np.zeros((12, 12)))
    assert np.linalg.matrix_rank(together) == 1
    blocks = together.reshape(4, 3, 4, 3)[np.arange(4), :, np.arange(4)]
    np.testing.assert_allclose(blocks, METRE.widened(POSES, np.zeros((4, 3, 3))))


@pytest.mark.parametrize("sigma", [0.0, 0.05])
def test_a_belief_counts_it_and_weighs_nothing_by_it(sigma: float) -> None:
    plain, room = (make_room(8, 0, clutter=0.05, perception={"sigma_range_scale": s}) for s in (0.0, sigma))
    beliefs = []
    for run in (plain.run, room.run):
        engine = Engine.of_run(run, InProcessPool(1))
        beliefs.append([engine.process(keyframe) for keyframe in room.keyframes][-1])
    without, found = beliefs
    np.testing.assert_array_equal(found.log_weights, without.log_weights)
    np.testing.assert_array_equal(found.poses, without.poses)
    pose = planar_from_pose_vector(found.poses[0])
    start = planar_from_pose_vector(room.run.initial_pose)
    away = pose[:2] - start[:2]
    gained = planar_from_covariance(found.pose_covariances[0]) - planar_from_covariance(without.pose_covariances[0])
    expected = sigma**2 * np.outer(away, away)
    np.testing.assert_allclose(gained[:2, :2], expected, atol=1e-9)
