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


@pytest.mark.parametrize("covariance", [None, 0.01 * np.eye(6)])
def test_what_does_not_grow_is_not_believed(covariance):
    """No covariance, and the same one in every message."""
    rows = points(covariances=False)
    stated = [replace(row, covariance=covariance) for row in rows]
    wanted = motion_covariance_in_space(rows[0], rows[2], OdometryConfiguration())
    np.testing.assert_array_equal(motion_covariance_in_space(stated[0], stated[2], OdometryConfiguration()), wanted)
    assert point_between(stated[0], stated[1], stated[0].stamp_ns + 1000).covariance is None
