"""SO(3) and SE(3): group axioms, inverse maps near no turn and near half a turn, and Jacobians by differences."""

from collections.abc import Callable

import gtsam
import numpy as np
import pytest

from semantic_slam.geometry import se3, so3
from semantic_slam.geometry.moments import matched_moments_of_many

RANDOM = np.random.default_rng(0)
AXES = RANDOM.normal(size=(40, 3))
AXES /= np.linalg.norm(AXES, axis=1, keepdims=True)
ANGLES = np.concatenate([[0.0, 1e-300, 1e-12, 1e-7, 1e-4, 0.049, 0.051, 0.157, 0.159], RANDOM.uniform(0.0, np.pi, 25)])
ANGLES = np.concatenate([ANGLES, np.pi - np.array([1e-3, 1e-6, 1e-9, 1e-12, 0.0, 0.3])])
TURNS = AXES * ANGLES[:, None]
TANGENTS = np.concatenate([TURNS, RANDOM.normal(size=(40, 3))], axis=1)
POSES = se3.exp(np.concatenate([RANDOM.uniform(-1.8, 1.8, (20, 3)), RANDOM.normal(size=(20, 3))], axis=1))


def as_gtsam(pose: np.ndarray) -> gtsam.Pose3:
    x, y, z, w = pose[3:]
    return gtsam.Pose3(gtsam.Rot3.Quaternion(w, x, y, z), pose[:3])


def differences(function: Callable[[np.ndarray], np.ndarray], size: int, step: float = 1e-6) -> np.ndarray:
    steps = step * np.eye(size)
    return np.stack([(function(own) - function(-own)) / (2.0 * step) for own in steps], axis=-1)


def test_exponential_and_composition_are_those_of_gtsam() -> None:
    for tangent, pose in zip(TANGENTS, se3.exp(TANGENTS), strict=True):
        np.testing.assert_allclose(gtsam.Pose3.Expmap(tangent).matrix(), as_gtsam(pose).matrix(), atol=1e-12)
    for a, b, c in zip(POSES[:10], POSES[10:], se3.compose(POSES[:10], POSES[10:]), strict=True):
        np.testing.assert_allclose(as_gtsam(a).compose(as_gtsam(b)).matrix(), as_gtsam(c).matrix(), atol=1e-12)


def test_log_inverts_exp_up_to_half_a_turn() -> None:
    np.testing.assert_allclose(so3.log(so3.exp(TURNS)), TURNS, atol=1e-15, rtol=1e-14)
    np.testing.assert_allclose(se3.log(se3.exp(TANGENTS)), TANGENTS, atol=1e-13)
    np.testing.assert_allclose(so3.log(-so3.exp(TURNS[:-6])), TURNS[:-6], atol=1e-15, rtol=1e-14)


def test_small_turns_keep_all_their_digits() -> None:
    small = 1e-9 * AXES
    np.testing.assert_allclose(so3.log(so3.exp(small)), small, rtol=1e-14)
    seen = so3.log(so3.product(so3.inverse(so3.exp(TURNS)), so3.product(so3.exp(TURNS), so3.exp(small))))
    np.testing.assert_allclose(seen, small, atol=5e-16)


def test_a_pose_composed_with_its_inverse_is_the_identity() -> None:
    nothing = np.tile([0.0, 0, 0, 0, 0, 0, 1], (20, 1))
    np.testing.assert_allclose(se3.wrapped(se3.compose(POSES, se3.inverse(POSES))), nothing, atol=1e-14)
    np.testing.assert_allclose(se3.between(POSES, POSES), nothing, atol=1e-14)


def test_quaternions_turn_as_their_matrices_do_and_are_had_from_them() -> None:
    q, vectors = so3.exp(TURNS), RANDOM.normal(size=(40, 3))
    np.testing.assert_allclose(so3.rotated(q, vectors), (so3.matrix(q) @ vectors[..., None])[..., 0], atol=1e-14)
    np.testing.assert_allclose(so3.matrix(so3.from_matrix(so3.matrix(q))), so3.matrix(q), atol=1e-14)


def test_adjoints_move_a_perturbation_to_the_other_side() -> None:
    e = RANDOM.normal(size=(20, 6))
    left = se3.compose(se3.exp((se3.adjoint(POSES) @ e[..., None])[..., 0]), POSES)
    np.testing.assert_allclose(se3.log(se3.between(left, se3.retract(POSES, e))), 0.0, atol=1e-12)
    np.testing.assert_allclose(
        se3.adjoint(POSES) @ se3.inverse_adjoint(POSES), np.tile(np.eye(6), (20, 1, 1)), atol=1e-12
    )


@pytest.mark.parametrize("tangents", [TANGENTS, 1e-3 * TANGENTS, 0.1 * TANGENTS])
def test_jacobians_against_differences(tangents: np.ndarray) -> None:
    at = se3.exp(tangents)
    right = differences(lambda step: se3.log(se3.between(at, se3.exp(tangents + step))), 6)
    np.testing.assert_allclose(se3.right_jacobian(tangents), right, atol=1e-8)
    left = differences(lambda step: se3.log(se3.compose(se3.exp(tangents + step), se3.inverse(at))), 6)
    np.testing.assert_allclose(se3.left_jacobian(tangents), left, atol=1e-8)
    np.testing.assert_allclose(so3.right_jacobian(tangents[:, :3]), right[:, :3, :3], atol=1e-8)


def test_jacobians_are_smooth_where_their_series_begin() -> None:
    """Both forms at one angle differ by rounding."""
    for square in (so3.SMALL_SQUARE, 10.0 * so3.SMALL_SQUARE):
        below, above = (TURNS[10] / ANGLES[10] * np.sqrt(square * (1.0 + side * 1e-12)) for side in (-1, 1))
        pair = np.array([[*below, 1.0, -2.0, 3.0], [*above, 1.0, -2.0, 3.0]])
        first, second = se3.left_jacobian(pair)
        np.testing.assert_allclose(first, second, atol=2e-11)
        np.testing.assert_allclose(*se3.log(se3.exp(pair)), atol=2e-11)


def test_batches_are_single_poses_along_any_axes() -> None:
    grid = POSES.reshape(4, 5, 7)
    tangents = TANGENTS[:20].reshape(4, 5, 6)
    for function, values in ((se3.log, grid), (se3.exp, tangents), (se3.adjoint, grid), (se3.left_jacobian, tangents)):
        np.testing.assert_array_equal(function(values)[2, 3], function(values[2, 3]))


def test_covariances_along_the_parent_s_axes_and_back() -> None:
    root = RANDOM.normal(size=(20, 6, 6))
    spread = root @ np.swapaxes(root, -1, -2)
    told = se3.covariance_along_parent(POSES, spread)
    np.testing.assert_allclose(se3.covariance_at_pose(POSES, told), spread, atol=1e-12)
    rotation = so3.matrix(POSES[:, 3:])
    np.testing.assert_allclose(told[:, :3, :3], rotation @ spread[:, 3:, 3:] @ np.swapaxes(rotation, 1, 2), atol=1e-12)


def test_the_mean_is_that_of_mixtures() -> None:
    weights = np.array([0.2, 0.5, 0.3])
    poses = np.stack([POSES[:4], se3.retract(POSES[:4], 0.3 * TANGENTS[10:14]), POSES[:4]])
    expected = matched_moments_of_many(weights, poses, np.zeros((3, 4, 6, 6)))[0]
    np.testing.assert_allclose(se3.log(se3.between(expected, se3.mean(poses, weights))), 0.0, atol=1e-12)
