"""Odometry by another clock than that of the detections: lines through its motions, and the offset that is found."""

import numpy as np
import pytest
from worlds.drives.late_odometry import LateDrive, late_drive, true_pose
from worlds.same_beliefs import assert_same

from semantic_slam.contracts.forgetful_pool import ForgetfulPool
from semantic_slam.geometry import se2
from semantic_slam.geometry.pose import planar_from_pose_vector, wrap_angle
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.models.noise.clock_offset import OFFSETS, line_at, shifts_of
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.states.tracked_objects import TrackedStates

CONTROL = np.array([0.5, 0.1, 0.3])
SIGMA_S = 0.2


def test_a_motion_that_changes_evenly_is_its_line() -> None:
    slope = np.array([0.02, -0.01, 0.05])
    for mean, sigma in ((0.0, 1.0), (-1.0, 0.1), (5.0, 0.3)):
        line = line_at(CONTROL, OFFSETS[:, None] * slope, mean, sigma)
        np.testing.assert_allclose(line.control, CONTROL, atol=1e-12)
        np.testing.assert_allclose(line.slope, slope, atol=1e-12)
        np.testing.assert_allclose(line.covariance, 0.0, atol=1e-12)


def test_a_motion_that_begins_in_between_is_followed_where_the_offset_is_known() -> None:
    shifts = np.maximum(OFFSETS, 0.0)[:, None] * np.array([0.0, 0.0, 0.2])
    wide, before, after = (line_at(np.zeros(3), shifts, *belief) for belief in ((0.0, 1.0), (-1.5, 0.1), (1.5, 0.1)))
    np.testing.assert_allclose([before.slope[2], after.slope[2]], [0.0, 0.2], atol=0.01)
    assert before.slope[2] < wide.slope[2] < after.slope[2]
    assert wide.covariance[2, 2] > 20.0 * max(before.covariance[2, 2], after.covariance[2, 2])
    means = [line.control[2] + line.slope[2] * mean for line, mean in ((before, -1.5), (after, 1.5))]
    np.testing.assert_allclose(means, [0.0, 0.3], atol=0.01)


def test_the_covariance_is_what_the_line_leaves() -> None:
    """Against weighted least squares by another route: orthogonal polynomials of the grid."""
    random = np.random.default_rng(0)
    shifts, mean, sigma = 0.01 * random.normal(size=(len(OFFSETS), 3)), 0.4, 0.8
    weights = np.exp(-0.5 * ((OFFSETS - mean) / sigma) ** 2)
    weights /= weights.sum()
    centred = OFFSETS - weights @ OFFSETS
    slope = (weights * centred) @ shifts / (weights @ centred**2)
    off = shifts - weights @ shifts - centred[:, None] * slope
    line = line_at(np.zeros(3), shifts, mean, sigma)
    np.testing.assert_allclose(line.covariance, np.einsum("g,gi,gj->ij", weights, off, off), atol=1e-12)


def test_shifts_lead_from_the_plain_motion_to_that_at_each_offset() -> None:
    controls = np.random.default_rng(1).normal(size=(len(OFFSETS), 3))
    shifts = shifts_of(controls)
    assert (shifts[len(OFFSETS) // 2] == 0.0).all()
    plain = np.broadcast_to(controls[len(OFFSETS) // 2], controls.shape)
    np.testing.assert_allclose(se2.compose(plain, se2.exp(shifts))[:, :2], controls[:, :2], atol=1e-9)


def test_keyframes_tell_the_motion_at_every_offset() -> None:
    drive = late_drive(0.0, SIGMA_S, duration_s=8.0)
    for k in range(1, len(drive.keyframes) - 3):
        control, shifts = planar_from_pose_vector(drive.keyframes[k].odometry), drive.keyframes[k].odometry_shifts
        assert shifts is not None
        for offset, shift in zip(OFFSETS * SIGMA_S, shifts, strict=True):
            ends = true_pose((k - 1) / 4 + offset), true_pose(k / 4 + offset)
            np.testing.assert_allclose(se2.compose(control, se2.exp(shift)), se2.between(*ends), atol=2e-3)


def test_without_an_offset_to_estimate_keyframes_tell_none() -> None:
    assert {keyframe.odometry_shifts is None for keyframe in late_drive(0.0, 0.0, duration_s=5.0).keyframes} == {True}


@pytest.mark.parametrize("expected_s", [-0.3, 0.3])
def test_what_is_expected_of_the_clock_chooses_no_other_frames(expected_s: float) -> None:
    policy = {"policy": "odometry", "distance_m": 0.2, "angle_rad": 0.2}
    drives = [late_drive(0.0, 0.0, duration_s=9.0, expected_s=own, keyframes=policy) for own in (0.0, expected_s)]
    stamps = [[keyframe.stamp_ns for keyframe in drive.keyframes] for drive in drives]
    assert 5 < len(stamps[0]) < 30 and stamps[0] == stamps[1]


@pytest.mark.parametrize("sigma_s", [0.0, SIGMA_S])
def test_an_offset_that_is_expected_is_in_the_motions_already(sigma_s: float) -> None:
    one_clock = late_drive(0.0, sigma_s, duration_s=8.0).keyframes
    expected = late_drive(0.25, sigma_s, duration_s=8.0, expected_s=0.25).keyframes
    for ours, theirs in zip(expected[:-3], one_clock[:-3], strict=True):  # the last ones are beyond the odometry
        np.testing.assert_allclose(ours.odometry, theirs.odometry, atol=1e-3)
        if sigma_s:
            np.testing.assert_allclose(ours.odometry_shifts, theirs.odometry_shifts, atol=2e-3)


def tracked_at_end(drive: LateDrive) -> tuple[TrackedStates, float]:
    """States under the best hypothesis, and the mean error of the heading over the drive [rad]."""
    pool = InProcessPool(1)
    engine, errors = Engine.of_run(drive.run, pool), []
    for keyframe, truth in zip(drive.keyframes, drive.truth, strict=True):
        belief = engine.process(keyframe)
        errors.append(abs(wrap_angle(planar_from_pose_vector(belief.poses[0])[2] - truth[2])))
    return pool._backends[0].held[next(iter(engine.live))].component.tracked, float(np.mean(errors))


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize("offset_s", [-0.2, 0.0, 0.3])
def test_the_offset_is_found(offset_s: float) -> None:
    found, error = tracked_at_end(late_drive(offset_s, SIGMA_S))
    mean, sigma = SIGMA_S * np.array(found.clock)
    assert abs(mean - offset_s) < 3.0 * sigma
    assert sigma < 0.03
    if offset_s:
        assert error < 0.5 * tracked_at_end(late_drive(offset_s, 0.0))[1]


@pytest.mark.long
@pytest.mark.parametrize("errors", [{}, {"correlated_share": 0.7}])
def test_a_lineage_is_rebuilt_with_its_offset(errors: dict[str, float]) -> None:
    """Errors repeat the less the further the robot went, which by each hypothesis's clock is another way."""
    drive = late_drive(-0.2, SIGMA_S, duration_s=4.0, detection_errors=errors)
    whole, divided = Engine.of_run(drive.run, InProcessPool(2)), Engine.of_run(drive.run, ForgetfulPool(2))
    for keyframe in drive.keyframes:
        assert_same(divided.process(keyframe), whole.process(keyframe))
