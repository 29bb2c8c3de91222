"""Coordinates of points that are seen from an anchor: whole rays, and x, y and z to first order."""

import numpy as np
import pytest

from semantic_slam.contracts.state_space import differences
from semantic_slam.inference.states.range_chart import coordinates, moved, moved_and_slopes, relative_sigmas

COUNT = 6


@pytest.fixture
def drawn() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Anchors, points and tangent vectors."""
    random = np.random.default_rng(1)
    anchors = random.normal(size=(COUNT, 3))
    return anchors, anchors + random.normal(loc=[2.0, 0.0, 0.0], size=(COUNT, 3)), random.normal(size=(COUNT, 3))


def test_slopes_by_differences(drawn: tuple[np.ndarray, ...]) -> None:
    anchors, points, t = drawn
    reached, slopes = moved_and_slopes(anchors, points, t)
    np.testing.assert_array_equal(reached, moved(anchors, points, t))
    numeric = differences(lambda step: moved(anchors, points, t + step), 3)
    np.testing.assert_allclose(slopes, numeric, atol=1e-6)
    at_points = moved_and_slopes(anchors, points, np.zeros((COUNT, 3)))
    np.testing.assert_allclose(at_points[0], points, atol=1e-12)
    np.testing.assert_allclose(at_points[1], np.tile(np.eye(3), (COUNT, 1, 1)), atol=1e-12)


def test_coordinates_lead_back(drawn: tuple[np.ndarray, ...]) -> None:
    anchors, points, t = drawn
    np.testing.assert_allclose(coordinates(anchors, points, moved(anchors, points, t)), t, atol=1e-9)


def test_steps_along_a_ray_stay_on_it_and_never_get_behind_the_anchor(drawn: tuple[np.ndarray, ...]) -> None:
    anchors, points, _ = drawn
    away = points - anchors
    distance = np.linalg.norm(away, axis=1, keepdims=True)
    for log_ratio in (-3.0, -0.5, 0.4, 2.0):
        reached = moved(anchors, points, log_ratio * away) - anchors
        np.testing.assert_allclose(reached, np.exp(log_ratio) * away, rtol=1e-12)
    along = np.einsum("ni,nj->nij", away, away) * 0.3**2
    np.testing.assert_allclose(relative_sigmas(anchors, points, along), 0.3, rtol=1e-9)
    assert (distance > 0.0).all()
