"""Covariances of poses that err along arcs, against a million of them."""

import numpy as np
import pytest

from semantic_slam.geometry import arc_moments, se2, se3
from semantic_slam.geometry.pose import covariance_from_planar, pose_vector_from_planar

POSE = np.array([3.0, -1.0, 0.8])
IN_SPACE = se3.exp(np.array([0.3, -0.5, 0.9, 1.0, 2.0, 0.5]))
BESIDES = np.diag([0.01, 0.01, 1e-4])


def after_a_drive(sigma_rad: float, length_m: float = 8.0) -> np.ndarray:
    """(3, 3) at the end of a straight drive, all of whose turn was wrong at its start; a decimetre each way besides."""
    swing = np.array([0.0, length_m, 1.0])
    return sigma_rad**2 * np.outer(swing, swing) + BESIDES


def assert_near(found: np.ndarray, expected: np.ndarray, atol: float) -> None:
    """Equal up to a share of the standard deviations."""
    scale = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(found / np.outer(scale, scale), expected / np.outer(scale, scale), atol=atol)


@pytest.mark.parametrize("sigma_rad", [0.1, 0.4, 0.8, 1.5, 3.0])
def test_planar_moments_are_those_of_drawn_poses(sigma_rad: float) -> None:
    covariance = after_a_drive(sigma_rad)
    errors = np.random.default_rng(1).multivariate_normal(np.zeros(3), covariance, size=1_000_000)
    apart = se2.retract(np.tile(POSE, (len(errors), 1)), errors) - POSE
    apart[:, 2] = errors[:, 2]
    assert_near(arc_moments.planar(POSE, covariance), apart.T @ apart / len(apart), atol=6e-3)


def test_moments_in_space_are_those_of_drawn_poses() -> None:
    """A shift of 4 m that goes with the attitude wholly, known to 0.3 rad about each axis."""
    random = np.random.default_rng(2)
    swing = np.concatenate([np.eye(3), 4.0 * random.normal(size=(3, 3))])
    errors = 0.3 * random.normal(size=(1_000_000, 3)) @ swing.T
    apart = se3.retract(np.tile(IN_SPACE, (len(errors), 1)), errors)[:, :3] - IN_SPACE[:3]
    covariance = 0.09 * swing @ swing.T
    found = arc_moments.spatial(IN_SPACE, covariance)
    assert_near(found[:3, :3], apart.T @ apart / len(apart), atol=0.02)
    first_order = se3.covariance_along_parent(IN_SPACE, covariance)
    np.testing.assert_allclose(found[3:, 3:], first_order[3:, 3:], atol=1e-12)


@pytest.mark.parametrize("sigma_rad", [0.4, 2.0])
def test_a_pose_in_space_that_turns_about_the_vertical_alone_is_one_in_the_plane(sigma_rad: float) -> None:
    planar = after_a_drive(sigma_rad)
    tangent = np.zeros((6, 6))
    tangent[np.ix_([3, 4, 2], [3, 4, 2])] = planar
    found = arc_moments.spatial(pose_vector_from_planar(POSE), tangent)
    np.testing.assert_allclose(found, covariance_from_planar(arc_moments.planar(POSE, planar)), atol=1e-9)


@pytest.mark.parametrize("sigma_rad", [0.0, 0.3, 3.0])
def test_a_position_that_errs_apart_from_the_heading_is_as_known_as_it_is(sigma_rad: float) -> None:
    covariance = np.diag([0.04, 0.01, sigma_rad**2])
    expected = se2.rotate_covariance(POSE, covariance)
    np.testing.assert_allclose(arc_moments.planar(POSE, covariance), expected, atol=1e-12)
    tangent = np.diag([1e-4, 1e-4, sigma_rad**2, 0.04, 0.01, 0.09])
    expected = se3.covariance_along_parent(IN_SPACE, tangent)
    np.testing.assert_allclose(arc_moments.spatial(IN_SPACE, tangent), expected, atol=1e-12)


def test_a_heading_variance_below_zero_by_rounding_is_zero() -> None:
    covariance = np.diag([0.04, 0.01, -1e-18])
    np.testing.assert_allclose(
        arc_moments.planar(POSE, covariance), se2.rotate_covariance(POSE, covariance), atol=1e-12
    )


def test_rows_of_a_batch_are_single_poses() -> None:
    poses = np.stack([POSE, -POSE])
    covariances = np.stack([after_a_drive(0.1), after_a_drive(0.7)])
    together = arc_moments.planar(poses, covariances)
    for row in range(2):
        np.testing.assert_array_equal(arc_moments.planar(poses[row], covariances[row]), together[row])
