"""How probably objects are in the sensor's region now and before, against drawn places."""

import numpy as np
import pytest

from semantic_slam.geometry import se2, se3, so3
from semantic_slam.inference.open_world.margins import Places
from semantic_slam.inference.open_world.planar.region import SensorRegion
from semantic_slam.inference.open_world.spatial.region import SpatialRegion

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
