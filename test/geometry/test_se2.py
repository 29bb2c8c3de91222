"""SE(2): group axioms, inverse maps, and Jacobians against finite differences."""

import gtsam
import numpy as np
import pytest

from semantic_slam.geometry import se2
from semantic_slam.geometry.moments import matched_moments
from semantic_slam.geometry.pose import (
    covariance_from_planar,
    planar_from_covariance,
    planar_from_pose_vector,
    pose_vector_from_planar,
)

RANDOM = np.random.default_rng(0)
POSES = np.concatenate([RANDOM.normal(size=(20, 2)), RANDOM.uniform(-3.1, 3.1, (20, 1))], axis=1)
TANGENTS = np.concatenate([RANDOM.normal(size=(20, 3)), [[1.0, -2.0, 0.0], [0.3, 0.1, 1e-7]]])


def test_composition_is_that_of_gtsam() -> None:
    composed = se2.compose(POSES[:10], POSES[10:])
    for a, b, c in zip(POSES[:10], POSES[10:], composed, strict=True):
        reference = gtsam.Pose2(*a).compose(gtsam.Pose2(*b))
        np.testing.assert_allclose([reference.x(), reference.y(), reference.theta()], c, atol=1e-12)


def test_a_pose_composed_with_its_inverse_is_the_identity() -> None:
    np.testing.assert_allclose(se2.compose(POSES, se2.inverse(POSES)), np.zeros((20, 3)), atol=1e-12)


def test_log_inverts_exp() -> None:
    tangents = TANGENTS[np.abs(TANGENTS[:, 2]) < np.pi]
    np.testing.assert_allclose(se2.log(se2.exp(tangents)), tangents, atol=1e-9)


def test_adjoint_moves_a_perturbation_to_the_other_side() -> None:
    small = 1e-3 * RANDOM.normal(size=(20, 3))
    right = se2.compose(POSES, se2.exp(small))
    left = se2.compose(se2.exp((se2.adjoint(POSES) @ small[..., None])[..., 0]), POSES)
    np.testing.assert_allclose(left, right, atol=1e-12)
    back = se2.compose(POSES, se2.exp((se2.inverse_adjoint(POSES) @ small[..., None])[..., 0]))
    np.testing.assert_allclose(back, se2.compose(se2.exp(small), POSES), atol=1e-12)
    np.testing.assert_allclose(se2.inverse_adjoint(POSES[0]), se2.inverse_adjoint(POSES)[0], atol=1e-15)


@pytest.mark.parametrize("axis", range(3))
def test_right_jacobian_against_differences(axis: int) -> None:
    step = np.zeros(3)
    step[axis] = 1e-6
    forward = se2.log(se2.between(se2.exp(TANGENTS), se2.exp(TANGENTS + step)))
    backward = se2.log(se2.between(se2.exp(TANGENTS), se2.exp(TANGENTS - step)))
    np.testing.assert_allclose(se2.right_jacobian(TANGENTS)[:, :, axis], (forward - backward) / 2e-6, atol=1e-8)
    np.testing.assert_allclose(se2.right_jacobian(TANGENTS[0]), se2.right_jacobian(TANGENTS)[0], atol=1e-15)


def test_planar_poses_and_covariances_survive_three_dimensions() -> None:
    np.testing.assert_allclose(planar_from_pose_vector(pose_vector_from_planar(POSES)), POSES, atol=1e-12)
    covariance = np.arange(9.0).reshape(3, 3)
    assert np.array_equal(planar_from_covariance(covariance_from_planar(covariance)), covariance)


def test_moments_of_two_equal_components_at_plus_minus_one() -> None:
    # Mean 0; variance within 0.1, variance between the means ((+1)^2 + (-1)^2) / 2 = 1.
    poses = pose_vector_from_planar(np.array([[1.0, 0.0, 0.2], [-1.0, 0.0, -0.2]]))
    mean, covariance = matched_moments(np.array([0.5, 0.5]), poses, np.tile(0.1 * np.eye(6), (2, 1, 1)))
    np.testing.assert_allclose(mean, [0, 0, 0, 0, 0, 0, 1], atol=1e-12)
    assert covariance[0, 0] == pytest.approx(1.1)
    assert covariance[5, 5] == pytest.approx(0.1 + 0.04)
    assert covariance[0, 5] == pytest.approx(0.2)


def test_frames_place_as_composition_does() -> None:
    placed = se2.placed(se2.frame(POSES[:10]), POSES[10:])
    np.testing.assert_allclose(placed[:, 2], POSES[:10, 2] + POSES[10:, 2], atol=1e-15)
    np.testing.assert_allclose(se2.wrapped(placed), se2.compose(POSES[:10], POSES[10:]), atol=1e-14)


def test_a_walk_is_one_step_after_the_other() -> None:
    start, steps = POSES[:4], POSES[4:].reshape(4, 4, 3)
    expected = [start]
    for number in range(4):
        expected.append(se2.compose(expected[-1], steps[:, number]))
    walked = se2.wrapped(se2.along(start, steps))
    np.testing.assert_allclose(se2.between(walked, np.stack(expected[1:], axis=1)), 0.0, atol=1e-12)
    assert se2.along(start, steps[:, :0]).shape == (4, 0, 3)
