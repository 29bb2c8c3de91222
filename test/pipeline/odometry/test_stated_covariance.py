"""Motions in space are as uncertain as their odometry states, where it states something that grows."""

from dataclasses import replace

import numpy as np
import pytest

from semantic_slam.configuration import OdometryConfiguration
from semantic_slam.datasets.space.noisy_odometry import noisy_odometry_in_space
from semantic_slam.datasets.space.path import SpatialPath
from semantic_slam.geometry import se3
from semantic_slam.inference.inputs.keyframe import OdometrySample
from semantic_slam.pipeline.odometry.motion import motion_covariance_in_space, point_between, start

STEPS = se3.exp(np.tile([0.05, -0.1, 0.2, 0.3, 0.05, -0.1], (8, 1)))
ORIGIN = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
SIGMAS = np.concatenate([np.full(3, 0.01), np.full(3, np.deg2rad(0.5) / 3.0)]) * np.sqrt(np.linalg.norm(STEPS[0, :3]))


def points(covariances=True):
    """Odometry with noise of 1 % a metre."""
    path = SpatialPath(np.arange(9) * 10**8 + 10**9, np.concatenate([ORIGIN[None], se3.along(ORIGIN, STEPS)]))
    told = noisy_odometry_in_space(path, 0.01, np.random.default_rng(0))
    found = []
    for stamp, pose, covariance in zip(told.stamps_ns.tolist(), told.poses, told.covariances, strict=True):
        sample = OdometrySample(stamp, pose, covariance if covariances else None)
        found.append(found[-1].advance(sample) if found else start(sample))
    return found


def test_the_motion_between_samples_has_the_covariance_of_its_own_noise():
    rows = points()
    found = motion_covariance_in_space(rows[4], rows[5], OdometryConfiguration())
    np.testing.assert_allclose(found, np.diag(SIGMAS**2), atol=1e-12)


def test_odometry_knows_its_own_start_which_states_zeros():
    rows = points()
    first = replace(rows[0], covariance=None)
    found = motion_covariance_in_space(first, rows[1], OdometryConfiguration())
    np.testing.assert_allclose(found, np.diag(SIGMAS**2), atol=1e-12)


@pytest.mark.parametrize("covariances", [True, False])
def test_from_an_instant_to_itself_nothing_moves(covariances):
    row = points(covariances)[0]
    assert np.abs(motion_covariance_in_space(row, row, OdometryConfiguration())).max() < 1e-7


def test_motions_between_samples_add_to_the_whole():
    rows = points()
    middle = point_between(rows[3], rows[4], (rows[3].stamp_ns + rows[4].stamp_ns) // 2)
    first, second, whole = (
        motion_covariance_in_space(*pair, OdometryConfiguration())[se3.TO_MESSAGE][:, se3.TO_MESSAGE]
        for pair in ((rows[3], middle), (middle, rows[4]), (rows[3], rows[4]))
    )
    slopes = se3.inverse_adjoint(se3.between(middle.pose, rows[4].pose))
    np.testing.assert_allclose(slopes @ first @ slopes.T + second, whole, atol=1e-12)


def test_after_a_jump_motions_have_the_covariance_stated_along_the_axes_of_the_new_origin():
    rows, T_new_old = points(), se3.exp(np.array([0.3, -0.2, 1.2, 5.0, -3.0, 1.0]))
    told = []
    for row in rows[4:]:
        pose = se3.compose(T_new_old, row.pose)
        stated = se3.covariance_along_parent(pose, se3.covariance_at_pose(row.pose, row.covariance))
        told.append(OdometrySample(row.stamp_ns, pose, stated))
    jumped = [rows[3].after_jump_to(told[0])]
    for sample in told[1:]:
        jumped.append(jumped[-1].advance(sample))
    np.testing.assert_allclose(jumped[-1].told_pose, told[-1].pose, atol=1e-12)
    for start_at, end_at in ((0, 1), (1, 4)):
        found = motion_covariance_in_space(jumped[start_at], jumped[end_at], OdometryConfiguration())
        wanted = motion_covariance_in_space(rows[4 + start_at], rows[4 + end_at], OdometryConfiguration())
        np.testing.assert_allclose(found, wanted, atol=1e-12)


@pytest.mark.parametrize("covariance", [None, 0.01 * np.eye(6)])
def test_what_does_not_grow_is_not_believed(covariance):
    """No covariance, and the same one in every message."""
    rows = points(covariances=False)
    stated = [replace(row, covariance=covariance) for row in rows]
    wanted = motion_covariance_in_space(rows[0], rows[2], OdometryConfiguration())
    np.testing.assert_array_equal(motion_covariance_in_space(stated[0], stated[2], OdometryConfiguration()), wanted)
    assert point_between(stated[0], stated[1], stated[0].stamp_ns + 1000).covariance is None
