"""Cameras that fly among points: consistent where they know which is which, and found where they are lost."""

import numpy as np
import pytest
from scipy.stats import chi2
from worlds.exact.spatial_fixtures import spatial
from worlds.scenes.flights import OPTICAL, ORIGIN, Flight

from semantic_slam import Engine, MapPrior, ObjectPrior
from semantic_slam.geometry import se3, so3

ROOMS = 10


def mapped(seed: int) -> tuple[float, float]:
    """Normalised squared errors of the pose and of one object after 20 keyframes of mapping."""
    random, start = np.random.default_rng(seed), np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
    sigmas = np.array([0.02, 0.02, 0.05, 0.05, 0.05, 0.05])
    spread = se3.covariance_along_parent(start, np.diag(sigmas**2))
    engine = Engine(spatial(association="given"), initial_pose=start, initial_covariance=spread)
    points = random.uniform([-2.0, -2.0, 0.0], [2.0, 2.0, 2.0], (12, 3))
    flight = Flight(random, points, se3.retract(start, random.normal(size=6) * sigmas))
    for _ in range(20):
        belief = flight.fly(engine, len(points), named=True)
    error = se3.log(se3.between(belief.poses[0], flight.x))
    spread = se3.covariance_at_pose(belief.poses[0], belief.pose_covariances[0])
    off = belief.object_poses[0, :3] - points[int(belief.object_names[0][1:])]
    return error @ np.linalg.solve(spread, error), off @ np.linalg.solve(belief.object_covariances[0, :3, :3], off)


@pytest.mark.long
def test_a_flying_camera_is_as_sure_as_it_is_right() -> None:
    """Normalised errors of pose and object, one of each in every room, are those of six and of three degrees."""
    for errors, degrees in zip(np.array([mapped(seed) for seed in range(ROOMS)]).T, (6, 3), strict=True):
        low, high = chi2.interval(0.95, degrees * ROOMS)
        assert low < errors.sum() < high


LOST_M, ANY_YAW = 3.0, 1.8
"""Standard deviations before the first keyframe, of the position and of the heading."""


def lost(seed: int, T_ahead_body: np.ndarray = ORIGIN) -> tuple[float, float]:
    """Error [m] and weight of the best hypothesis after ten keyframes among ten points, at most three in sight.

    Gravity is known: roll and pitch to half a degree at the start.
    """
    random = np.random.default_rng(seed)
    points = random.uniform([-3.0, -3.0, 0.0], [3.0, 3.0, 2.0], (10, 3))
    places = random.uniform([-1.5, -1.5, 0.8], [1.5, 1.5, 1.4]), LOST_M * random.normal(size=3)
    yaws = np.zeros((2, 3))
    yaws[:, 2] = random.uniform(-3.0, 3.0, 2)
    start, guess = (np.append(place, so3.exp(yaw)) for place, yaw in zip((places[0], sum(places)), yaws, strict=True))
    engine = Engine(
        spatial(weights={"importance_samples": 256}, pruning={}),
        MapPrior(tuple(ObjectPrior.point(n, place, sigma_m=0.05) for n, place in enumerate(points))),
        initial_pose=se3.compose(guess, T_ahead_body),
        initial_covariance=np.diag([LOST_M, LOST_M, LOST_M, 0.01, 0.01, ANY_YAW]) ** 2,
    )
    flight = Flight(random, points, start, T_ahead_body)
    for _ in range(10):
        belief = flight.fly(engine, 3, named=False)
    return float(np.linalg.norm(belief.poses[0, :3] - flight.x[:3])), float(np.exp(belief.log_weights[0]))


@pytest.mark.long
def test_a_camera_lost_by_metres_and_any_yaw_is_settled_right() -> None:
    """In nine of ten rooms at least; position and heading follow from which of the look-alikes it sees."""
    found = [lost(seed) for seed in range(ROOMS)]
    assert sum(error < 0.3 and weight > 0.5 for error, weight in found) >= 9, found


@pytest.mark.long
def test_the_axes_of_the_body_are_the_user_s_to_choose() -> None:
    """Rooms of which some were lost when a heading was a turn about the body's own z, which is level here."""
    for seed in (1, 3):
        np.testing.assert_allclose(lost(seed, OPTICAL), lost(seed), rtol=1e-3, atol=1e-3)
