"""What odometry always gets wrong: its model against exact composition, its estimate where the truth is known."""

import dataclasses

import gtsam
import numpy as np
import pytest
from worlds.drives.late_odometry import late_drive
from worlds.drives.open_room import Room, make_room
from worlds.same_beliefs import assert_same

from semantic_slam.contracts.forgetful_pool import ForgetfulPool
from semantic_slam.errors import InputError
from semantic_slam.geometry import se2
from semantic_slam.geometry.pose import planar_from_pose_vector, pose_vector_from_planar
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.inputs.planar_reader import PlanarReader
from semantic_slam.inference.models.odometry_bias import bias_prior, biased_factor, composed_slopes, slopes
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.smoothing.local_map import LocalDetection, LocalMap
from semantic_slam.inference.states.keys import bias_key
from semantic_slam.inference.states.layout import Layout
from semantic_slam.inference.states.tracked_objects import TrackedStates

PRIOR = {"estimate_bias": True, "sigma_bias_rad_per_m": 0.05, "sigma_bias_scale": 0.1}
PRIOR_SIGMAS = np.array([0.05, 0.1, 0.0, 0.0])
BIAS = bias_key(-1)
CONTROLS = np.array([[0.8, 0.05, 0.2], [1.1, -0.1, -0.4], [0.0, 0.0, 0.3], [-0.5, 0.02, 0.1]])


def biased(control: np.ndarray, bias: np.ndarray) -> np.ndarray:
    """One arc with ``bias``: a turn per metre, a share of the length, and of the turn."""
    twist = se2.log(control)
    return se2.exp(twist + np.array([bias[1] * twist[0], bias[1] * twist[1], bias[0] * twist[0] + bias[2] * twist[2]]))


@pytest.mark.parametrize("number", [0, 1, 2])
def test_slopes_are_derivatives_of_the_composed_arcs(number: int) -> None:
    step = 1e-6 * np.eye(3)[number]
    total, with_bias, found = np.zeros(3), np.zeros(3), np.zeros((3, 3))
    for control in CONTROLS:
        np.testing.assert_allclose(
            se2.log(se2.between(control, biased(control, step))) / 1e-6, slopes(control)[:, number], atol=1e-5
        )
        total, with_bias = se2.compose(total, control), se2.compose(with_bias, biased(control, step))
        found = composed_slopes(found, control, slopes(control))
    np.testing.assert_allclose(se2.log(se2.between(total, with_bias)) / 1e-6, found[:, number], atol=1e-5)


def test_the_factor_is_that_of_gtsam_minus_the_bias() -> None:
    keys, covariance = (1, 2), np.diag([0.01, 0.02, 0.003])
    values = bias_prior(4)[1]
    values.insert(1, gtsam.Pose2(0.3, 0.2, 0.4))
    values.insert(2, gtsam.Pose2(1.0, 0.7, 0.9))
    control, by_bias = CONTROLS[0], np.column_stack([slopes(CONTROLS[0]), [0.1, -0.2, 0.3]])
    own = biased_factor((*keys, BIAS), control, covariance, by_bias)
    noise = gtsam.noiseModel.Gaussian.Covariance(covariance)
    plain = gtsam.BetweenFactorPose2(*keys, gtsam.Pose2(*control), noise)
    assert own.error(values) == pytest.approx(plain.error(values))
    step, numeric = 1e-6, np.zeros((3, 10))
    for column in range(10):
        change = step * np.eye(10)[column]
        moved = [_moved(values, sign * change) for sign in (1.0, -1.0)]
        numeric[:, column] = (own.unwhitenedError(moved[0]) - own.unwhitenedError(moved[1])) / (2.0 * step)
    by_key = dict(zip(own.keys(), np.split(own.linearize(values).jacobian()[0], [3, 6], axis=1), strict=True))
    np.testing.assert_allclose(np.hstack([by_key[1], by_key[2], by_key[BIAS]]), numeric, atol=1e-5)


def _moved(values: gtsam.Values, change: np.ndarray) -> gtsam.Values:
    moved = gtsam.Values()
    moved.insert(1, values.atPose2(1).retract(change[:3]))
    moved.insert(2, values.atPose2(2).retract(change[3:6]))
    moved.insert(BIAS, values.atVector(BIAS) + change[6:])
    return moved


def test_the_local_map_is_the_filter_of_robot_bias_and_objects() -> None:
    """Against dense matrices over [robot, bias, two objects]."""
    random = np.random.default_rng(0)
    root = random.normal(size=(11, 11))
    before = root @ root.T
    transition, noise = random.normal(size=(3, 5)), np.diag([0.1, 0.2, 0.3])
    seen = LocalDetection(7, random.normal(size=(2, 3)), random.normal(size=(2, 3)), np.zeros((2, 0)))
    robot, objects = np.zeros(3), np.zeros((2, 3))
    local = (
        LocalMap(
            layout=Layout(3, 3), ids=np.array([4, 7]), robot=robot, objects=objects, covariance=before, num_biases=2
        )
        .moved(robot, before, transition, noise)
        .updated([seen])
    )
    full, jacobian = np.eye(11), np.zeros((2, 11))
    full[:3, :5] = transition
    jacobian[:, :3], jacobian[:, 8:] = seen.by_robot, seen.by_object
    moved = full @ before @ full.T
    moved[:3, :3] += noise
    gain = moved @ jacobian.T @ np.linalg.inv(jacobian @ moved @ jacobian.T + np.eye(2))
    expected = moved - gain @ jacobian @ moved
    np.testing.assert_allclose(local.covariance, expected, atol=1e-9)
    rows = [0, 1, 2, 8, 9, 10]
    np.testing.assert_allclose(local.of(np.array([7])), expected[np.ix_(rows, rows)], atol=1e-9)


def test_a_bias_that_is_expected_is_in_the_motion_already() -> None:
    expected = np.array([0.04, -0.06, 0.05, 0.3])
    keyframe = make_room(1).keyframes[0]
    plain = PlanarReader(0, PRIOR_SIGMAS).step(keyframe).motion
    moved = PlanarReader(0, PRIOR_SIGMAS, bias_means=expected).step(keyframe).motion
    np.testing.assert_allclose(moved.control, biased(plain.control, expected[:3]), atol=1e-4)
    np.testing.assert_array_equal(moved.by_bias, plain.by_bias)


def room_with(bias: np.ndarray, num_keyframes: int, seed: int) -> Room:
    """A room whose odometry leaves out ``bias``, so that the motion has it on top."""
    room = make_room(num_keyframes, seed, clutter=0.05, odometry=PRIOR, open_world={"iterate_updates": False})
    step = planar_from_pose_vector(room.keyframes[0].odometry)
    odometry = pose_vector_from_planar(se2.retract(step, -slopes(step)[:, :2] @ bias))
    keyframes = [dataclasses.replace(keyframe, odometry=odometry) for keyframe in room.keyframes]
    return dataclasses.replace(room, keyframes=keyframes)


def population_after(room: Room) -> TrackedStates:
    """Of the best hypothesis at the end."""
    pool = InProcessPool(1)
    manager = Engine.of_run(room.run, pool)
    for keyframe in room.keyframes:
        manager.process(keyframe)
    best = max(manager.live, key=lambda n: manager.live[n].log_weight)
    return pool._backends[0].held[best].component.tracked


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize("bias", [(0.04, -0.06), (0.0, 0.0)], ids=["biased", "right"])
def test_the_bias_is_found(bias: tuple[float, float]) -> None:
    """Odometry alone, exact, would leave 0.01 / (0.25 sqrt(K)) rad/m and 0.02 / (0.25 sqrt(K)): no less is claimed."""
    for seed in range(3):
        found = population_after(room_with(np.array(bias), 60, seed))
        sigmas = np.sqrt(np.diag(found.propagated_covariance)[3:]) * PRIOR_SIGMAS
        assert (np.abs(found.bias * PRIOR_SIGMAS - (*bias, 0.0, 0.0)) <= 3.0 * sigmas).all()
        floor = np.array([0.01, 0.02]) / (0.25 * np.sqrt(60))
        assert (sigmas[:2] > 0.8 * floor).all()
        assert (sigmas[:2] < 3.0 * floor).all()


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize("scale", [-0.08, 0.0, 0.08])
def test_the_error_of_turns_is_found(scale: float) -> None:
    drive = late_drive(0.0, 0.0, turn_scale=scale, odometry={"sigma_bias_turn_scale": 0.1})
    pool = InProcessPool(1)
    engine = Engine.of_run(drive.run, pool)
    for keyframe in drive.keyframes:
        belief = engine.process(keyframe)
    at = belief.noise_names.index("odometry.bias_turn_scale")
    assert abs(belief.noise_values[at] - scale) < 3.0 * belief.noise_sigmas[at]
    assert belief.noise_sigmas[at] < 0.02


def test_a_lineage_is_rebuilt_with_its_bias() -> None:
    room = room_with(np.array([0.04, -0.06]), 14, 0)
    whole = Engine.of_run(room.run, InProcessPool(2))
    divided = Engine.of_run(room.run, ForgetfulPool(2))
    for keyframe in room.keyframes:
        assert_same(divided.process(keyframe), whole.process(keyframe))


def test_only_single_steps_estimate_it() -> None:
    with pytest.raises(InputError, match="iterate_updates"):
        make_room(1, odometry=PRIOR)
