"""A robot on wheels in space: odometry cannot leave its plane, as configured, and errs within it as ever."""

import numpy as np
import pytest
from worlds.exact.spatial_fixtures import spatial

from semantic_slam import Detection, Engine, HybridBelief, Keyframe
from semantic_slam.configuration import OdometryConfiguration
from semantic_slam.geometry import se3, so3
from semantic_slam.inference.inputs.keyframe import OdometrySample
from semantic_slam.inference.models.noise.odometry_noise import (
    OUT_OF_PLANE_FLOOR_M,
    OUT_OF_PLANE_FLOOR_RAD,
    odometry_covariance_in_space,
    odometry_variances,
)
from semantic_slam.pipeline.odometry.motion import motion_covariance_in_space, start

STEP_M, COUNT = 0.2, 100
ON_WHEELS = {"sigma_out_of_plane_translation_per_m": 1e-4, "sigma_out_of_plane_rotation_per_m": 1e-4}
IN_PLANE = [0, 1, 5]
"""Of x y z rx ry rz: x, y and yaw."""


def driven(odometry: dict[str, float], *, sees: bool = False, turn_rad: float = 0.0) -> HybridBelief:
    """After 20 m; ``sees``: three points beside the way, with noise of which nobody corrects the height."""
    start_sigmas = [0.01, 0.01, 1e-3, 1e-4, 1e-4, 0.01]
    engine = Engine(
        spatial(association="given", odometry=odometry, initial_pose={"mean": [0.0] * 6, "sigma": start_sigmas})
    )
    motion, x = np.append([STEP_M, 0.0, 0.0], so3.exp(np.array([0.0, 0.0, turn_rad]))), se3.exp(np.zeros(6))
    random = np.random.default_rng(0)
    for k in range(COUNT):
        x = se3.compose(x, motion)
        seen = [_seen(x, n, random) for n in range(3)] if sees and k % 10 == 0 else []
        belief = engine.process(Keyframe.spatial(k, motion=motion, detections=seen))
    return belief


def _seen(x: np.ndarray, number: int, random: np.random.Generator) -> Detection:
    away = so3.rotated(so3.inverse(x[3:]), np.array([8.0 * number, 2.0, 1.0]) - x[:3])
    distance = float(np.linalg.norm(away))
    ray = away / distance + 0.02 * random.normal(size=3)
    noise = {"sigma_range_m": 0.1, "ray_covariance": 4e-4 * np.eye(3)}
    return Detection.along(ray, distance + 0.1 * random.normal(), track_id=f"p{number}", **noise)


@pytest.mark.long
def test_twenty_metres_straight_keep_height_and_the_plane_is_as_before() -> None:
    before, found = driven({}), driven(ON_WHEELS)
    wide, tight = before.pose_covariances[0], found.pose_covariances[0]
    assert np.sqrt(wide[2, 2]) > 0.9 and np.sqrt(tight[2, 2]) < 0.01
    assert np.sqrt(np.diagonal(tight)[3:5]).max() < 0.001
    across = np.ix_(IN_PLANE[1:], IN_PLANE[1:])
    np.testing.assert_allclose(tight[across], wide[across], rtol=5e-3)
    assert tight[0, 0] < wide[0, 0]  # a pitch that nobody knows shortens the way along an arc
    np.testing.assert_allclose(found.poses, before.poses, atol=1e-9)


@pytest.mark.long
def test_detections_hardly_lift_a_robot_on_wheels() -> None:
    """On a curve, with points whose heights are seen with an error of centimetres."""
    lifted, kept = (abs(driven(own, sees=True, turn_rad=0.02).poses[0, 2]) for own in ({}, ON_WHEELS))
    assert kept < 0.003 < lifted


@pytest.mark.parametrize(("travelled_m", "turned_rad"), [(0.0, 0.0), (0.3, 0.1), (5.0, 2.0)])
def test_all_axes_are_alike_unless_wheels_are_configured(travelled_m: float, turned_rad: float) -> None:
    """To the last bit; a robot on wheels never gets below its floors."""
    wanted = np.diag(np.repeat(odometry_variances(travelled_m, turned_rad, OdometryConfiguration()), 3))
    np.testing.assert_array_equal(
        odometry_covariance_in_space(travelled_m, turned_rad, OdometryConfiguration()), wanted
    )
    found = odometry_covariance_in_space(travelled_m, turned_rad, OdometryConfiguration(**ON_WHEELS))
    np.testing.assert_array_equal(found[IN_PLANE], wanted[IN_PLANE])
    least = np.array([OUT_OF_PLANE_FLOOR_M, OUT_OF_PLANE_FLOOR_RAD, OUT_OF_PLANE_FLOOR_RAD])
    np.testing.assert_allclose(np.diagonal(found)[2:5], least**2 + (1e-4 * travelled_m) ** 2)


def test_odometry_of_a_bag_has_the_same_noise_and_missing_odometry_does_not_lift_the_robot() -> None:
    noise, ahead = OdometryConfiguration(**ON_WHEELS), np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    first = start(OdometrySample(0, se3.exp(np.zeros(6))))
    second = first.advance(OdometrySample(10**9, ahead))
    found = motion_covariance_in_space(first, second, noise)
    np.testing.assert_array_equal(found, odometry_covariance_in_space(1.0, 0.0, noise))
    missing = odometry_covariance_in_space(1.0, 0.0, noise, (4.0, 0.5))
    np.testing.assert_allclose(np.diagonal(missing)[IN_PLANE], np.diagonal(found)[IN_PLANE] + [4.0, 4.0, 0.5])
    assert np.sqrt(np.diagonal(missing)[2:5]).max() < 0.001
