"""Covariances of poses that err along arcs, against a million of them."""

import numpy as np
import pytest

from semantic_slam.geometry import arc_moments, se2, se3
from semantic_slam.geometry.pose import covariance_from_planar, pose_vector_from_planar

POSE = np.array([3.0, -1.0, 0.8])
DRIVES = {"heading known to 0.1 rad": 0.1, "heading known to 0.4 rad": 0.4, "heading known to 0.8 rad": 0.8}
MESSAGE_IN_SPACE = [3, 4, 5, 0, 1, 2]


def after_a_drive(sigma_rad: float, length_m: float = 8.0) -> np.ndarray:
    """(3, 3) at the end of a straight drive, all of whose turn was wrong at its start; a decimetre each way besides."""
    swing = np.array([0.0, length_m, 1.0])
    return sigma_rad**2 * np.outer(swing, swing) + np.diag([0.01, 0.01, 1e-4])


@pytest.mark.parametrize("sigma_rad", DRIVES.values(), ids=DRIVES)
def test_planar_moments_are_those_of_drawn_poses(sigma_rad: float) -> None:
    covariance = after_a_drive(sigma_rad)
    errors = np.random.default_rng(1).multivariate_normal(np.zeros(3), covariance, size=1_000_000)
    apart = se2.retract(np.tile(POSE, (len(errors), 1)), errors) - POSE
    apart[:, 2] = errors[:, 2]
    found = arc_moments.planar(POSE, covariance)
    scale = np.sqrt(np.diag(found))
    np.testing.assert_allclose(
        found / np.outer(scale, scale), apart.T @ apart / len(apart) / np.outer(scale, scale), atol=6e-3
    )


def test_moments_in_space_are_those_of_drawn_poses() -> None:
    pose = se3.exp(np.array([0.3, -0.5, 0.9, 1.0, 2.0, 0.5]))
    root = 0.25 * np.random.default_rng(2).normal(size=(6, 6)) * np.array([1.0, 1.0, 1.0, 4.0, 4.0, 4.0])[:, None]
    errors = np.random.default_rng(3).normal(size=(1_000_000, 6)) @ root.T
    moved = se3.retract(np.tile(pose, (len(errors), 1)), errors)
    found = arc_moments.spatial(pose, root @ root.T)
    apart = moved[:, :3] - pose[:3]
    scale = np.sqrt(np.diag(found)[:3])
    expected = apart.T @ apart / len(apart) / np.outer(scale, scale)
    np.testing.assert_allclose(found[:3, :3] / np.outer(scale, scale), expected, atol=8e-3)
    flat = se3.covariance_along_parent(pose, root @ root.T)
    np.testing.assert_allclose(found[3:, 3:], flat[3:, 3:], atol=1e-12)


def test_a_pose_in_space_that_turns_about_the_vertical_alone_is_one_in_the_plane() -> None:
    planar = after_a_drive(0.4)
    tangent = np.zeros((6, 6))
    tangent[np.ix_([3, 4, 2], [3, 4, 2])] = planar
    found = arc_moments.spatial(pose_vector_from_planar(POSE), tangent)
    np.testing.assert_allclose(found, covariance_from_planar(arc_moments.planar(POSE, planar)), atol=1e-9)


def test_moments_of_a_known_heading_are_the_rotated_covariance() -> None:
    covariance = np.diag([0.04, 0.01, 0.0])
    np.testing.assert_allclose(
        arc_moments.planar(POSE, covariance), se2.rotate_covariance(POSE, covariance), atol=1e-15
    )


def test_rows_of_a_batch_are_single_poses() -> None:
    poses = np.stack([POSE, -POSE])
    covariances = np.stack([after_a_drive(0.1), after_a_drive(0.7)])
    together = arc_moments.planar(poses, covariances)
    for row in range(2):
        np.testing.assert_array_equal(arc_moments.planar(poses[row], covariances[row]), together[row])
