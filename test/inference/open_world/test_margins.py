"""How probably objects are in the sensor's region now and before, against drawn places."""

import numpy as np
import pytest

from semantic_slam.geometry import se2, se3, so3
from semantic_slam.inference.open_world.margins import Places
from semantic_slam.inference.open_world.planar.region import SensorRegion
from semantic_slam.inference.open_world.spatial.region import SpatialRegion
from semantic_slam.inference.states.in_view import InViewProbabilities, InViewRecord
from semantic_slam.inference.states.miss_runs import MissRuns

PLANAR = SensorRegion(min_range_m=0.5, max_range_m=5.0, field_of_view_rad=1.4)
SPATIAL = SpatialRegion(min_range_m=0.5, max_range_m=5.0, half_width_rad=0.6, half_height_rad=0.4)
COUNT = 100_000


def places(points: list[list[float]], spread: np.ndarray, turn: np.ndarray, shift: list[float]) -> Places:
    """Of a sensor that has moved exactly."""
    nothing = np.zeros((len(points), *spread.shape))
    return Places(np.array(points), spread + nothing, nothing, nothing, turn, np.array(shift))


@pytest.mark.parametrize(("turn", "shift"), [(0.0, [0.0, 0.0]), (0.0, [-0.3, 0.1]), (0.15, [0.0, 0.0]), (1.4, [0, 0])])
def test_in_the_plane_they_are_in_view_in_both_as_often_as_drawn_places_are(turn: float, shift: list[float]) -> None:
    before, random = np.array([*shift, turn]), np.random.default_rng(1)
    points, spread = [[4.9, 0.2], [3.0, 2.5], [2.5, -2.0], [1.5, 1.2]], 0.04 * np.array([[1.0, 0.3], [0.3, 1.5]])
    turned = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    overlap, _ = places(points, spread, turned, shift).overlap(PLANAR.margins)
    for row, point in enumerate(points):
        drawn = random.multivariate_normal(point, spread, COUNT)
        then = se2.between(before, np.c_[drawn, np.zeros(COUNT)])
        inside, was = (PLANAR.holds(np.hypot(*own[:, :2].T), np.arctan2(own[:, 1], own[:, 0])) for own in (drawn, then))
        told = [each[row] for each in overlap]
        np.testing.assert_allclose(told, [was.mean(), inside.mean(), (inside & was).mean()], atol=0.04)


def test_in_space_they_are_in_view_in_both_as_often_as_drawn_places_are() -> None:
    random, points, spread = (
        np.random.default_rng(2),
        [[0.0, 0.2, 4.9], [2.0, 0.0, 3.0], [0.5, 1.3, 3.0]],
        0.02 * np.eye(3),
    )
    for vector in ([0.0] * 6, [0.0, 0.05, 0.0, 0.1, 0.0, 0.2], [0.0, 1.2, 0.0, 0.0, 0.0, 0.0]):
        before = se3.exp(np.array(vector))
        shifted = places(points, spread, so3.matrix(before[3:]), before[:3].tolist())
        overlap, _ = shifted.overlap(SPATIAL.margins)
        for row, point in enumerate(points):
            drawn = random.multivariate_normal(point, spread, COUNT)
            inside = SPATIAL.holds(drawn)
            was = SPATIAL.holds(so3.rotated(so3.inverse(before[3:]), drawn - before[:3]))
            told = [each[row] for each in overlap]
            np.testing.assert_allclose(told, [was.mean(), inside.mean(), (inside & was).mean()], atol=0.04)


def test_what_the_motion_may_have_changed_counts_as_drawn_anew() -> None:
    """A place that the motion's noise alone makes uncertain is in view independently of before."""
    spread = 0.04 * np.eye(2)
    own = places([[5.0, 0.0]], spread, np.eye(2), [0.0, 0.0])
    overlap, lasting = own._replace(by_robot=own.covariance, by_motion=own.covariance).overlap(PLANAR.margins)
    np.testing.assert_allclose(lasting, 0.0, atol=1e-4)
    np.testing.assert_allclose(overlap.both, overlap.before * overlap.now, atol=1e-4)


@pytest.mark.parametrize("hidden", [0.0, 1.0, 8.0])
@pytest.mark.parametrize("detectable", [None, 0.8])
def test_detections_of_an_object_are_together_as_probable_as_that_it_is_detected(
    hidden: float, detectable: float | None
) -> None:
    """Averaged over drawn measurements of its place: with the miss, the outcomes sum to one."""
    random, count, sigmas, spread = np.random.default_rng(3), 20_000, np.array([0.3, 0.2]), np.diag([0.25, 0.16])
    at = None if detectable is None else np.full((1, 1), detectable)
    views = InViewRecord(hidden=np.full((1, 1), hidden), unoccluded=np.ones(1), detectable=at, detectable_hidden=at)
    own, runs, chance = places([[4.8, 0.0]], spread, np.eye(2), [-0.2, 0.0]), MissRuns(0.6, 0.5), np.full((1, 1), 0.6)
    expected, _ = own.overlap(PLANAR.margins)
    predicted = views.predicted(
        InViewProbabilities(*(part[None] for part in expected)), np.ones((1, 1)), chance[None], runs
    )
    off = random.normal(size=(count, 2)) * np.sqrt(np.diag(spread) + sigmas**2)
    points = own.points + off * np.diag(spread) / (np.diag(spread) + sigmas**2)
    everywhere = np.zeros(count, dtype=int)
    seen = own._replace(**{name: getattr(own, name)[everywhere] for name in ("covariance", "by_robot", "by_motion")})
    found, _ = seen.measured(points, np.tile(np.diag(1.0 / sigmas), (count, 1, 1))).overlap(PLANAR.margins)
    expected = InViewProbabilities(*(part[everywhere] for part in expected))
    detected = views.take(everywhere).seen(expected, found, chance[everywhere], runs)
    np.testing.assert_allclose(detected.mean(), predicted.detected.item(), rtol=0.03)


def test_a_measurement_of_a_place_leaves_what_a_gaussian_update_leaves() -> None:
    """Of robot and object: the covariance of the object relative to the robot, which sees it and its own position."""
    by_object, by_robot, noise = np.diag([1.0, 0.3]), np.array([[0.2, 0.05], [0.05, 0.1]]), np.diag([0.04, 0.01])
    joint = np.zeros((4, 4))
    joint[:2, :2], joint[2:, 2:] = by_robot, by_object
    relative = np.hstack([-np.eye(2), np.eye(2)])
    gain = joint @ relative.T @ np.linalg.inv(relative @ joint @ relative.T + noise)
    after = joint - gain @ relative @ joint
    nothing = np.zeros((2, 2))
    own = Places(np.ones(2), after[:2, :2] + by_object, after[:2, :2], nothing, np.eye(2), np.zeros(2))
    left = own.measured(np.ones(2), np.diag(1.0 / np.sqrt(np.diag(noise))))
    np.testing.assert_allclose(left.covariance, relative @ after @ relative.T)
