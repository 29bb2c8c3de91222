"""The yaw that views tell of an upright object, put into a pose that does not know it."""

import numpy as np
import pytest

from semantic_slam.geometry import se3, so3
from semantic_slam.geometry.pose import planar_from_pose_vector, wrap_angle
from semantic_slam.inference.states.yaw import Yaw

CELLS = 72
UPRIGHT = np.append([1.0, -2.0, 0.5], so3.exp(np.array([0.0, 0.0, 2.5])))


def test_a_wrapped_normal_has_its_mean_and_variance() -> None:
    angles, sigma, mean = 2.0 * np.pi / CELLS * np.arange(CELLS), 0.5, -3.0
    density = np.exp(-0.5 * (wrap_angle(angles - mean) / sigma) ** 2)
    found = Yaw.of(density / density.sum())
    assert found.mean_rad == pytest.approx(mean, abs=1e-6)
    assert found.variance == pytest.approx(sigma**2, rel=1e-6)


def test_only_the_yaw_changes() -> None:
    """Position and tilt keep their covariance along the axes of map."""
    root = np.random.default_rng(0).normal(size=(6, 6))
    root[[0, 1, 3, 4, 5], 2], root[2, [0, 1, 3, 4, 5]], root[2, 2] = 0.0, 0.0, 3.1
    spread = root @ root.T
    pose, after = Yaw(-1.0, 0.04).applied(UPRIGHT, spread)
    np.testing.assert_allclose(planar_from_pose_vector(pose)[2], -1.0, atol=1e-12)
    np.testing.assert_array_equal(pose[:3], UPRIGHT[:3])
    before, now = se3.covariance_along_parent(UPRIGHT, spread), se3.covariance_along_parent(pose, after)
    np.testing.assert_allclose(now[:5, :5], before[:5, :5], atol=1e-12)
    np.testing.assert_allclose(now[5], [0.0, 0.0, 0.0, 0.0, 0.0, 0.04], atol=1e-12)


def test_a_yaw_that_is_known_better_stays() -> None:
    nothing = Yaw.of(np.full(CELLS, 1.0 / CELLS))
    pose, after = nothing.applied(UPRIGHT, 9.0 * np.eye(6))
    np.testing.assert_array_equal(pose, UPRIGHT)
    np.testing.assert_array_equal(after, 9.0 * np.eye(6))
