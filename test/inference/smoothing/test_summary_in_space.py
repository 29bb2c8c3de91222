"""Poses in space marginalised out: nothing is lost of rays, however far their objects are, nor by turning the map."""

from collections.abc import Callable

import gtsam
import numpy as np
import pytest

from semantic_slam.geometry import se3, so3
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.spatial.detection import SpatialDetection
from semantic_slam.inference.models.spatial.gravity import Gravity
from semantic_slam.inference.models.spatial.observation import POSES_AND_POINTS_IN_SPACE, SpatialObservation
from semantic_slam.inference.models.spatial.views import POSES_IN_SPACE
from semantic_slam.inference.smoothing.past.summary import Summary, summary_of
from semantic_slam.inference.smoothing.past.summary_in_space import inverse_range
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.keys import object_key, robot_key
from semantic_slam.inference.states.spaces import Spaces
from semantic_slam.inference.states.tracked_objects import LOOKS_FROM_A_PLACE, TrackedStates

KEPT, STEP = robot_key(3), se3.exp(np.array([0.02, -0.03, 0.2, 0.3, 0.1, 0.05]))
START = se3.exp(np.array([0.3, -0.2, 0.5, 1.0, 2.0, 0.3]))
PLACES = np.array([[2.5, 2.4, 0.8], [2.0, 3.5, 0.1]])


def flight(spaces: Spaces, *, gravity: bool = False) -> tuple[list, gtsam.Values]:
    """Four poses along two objects of a map that may lie anywhere and turn; all fits."""
    factors, values = spaces.robot.prior_factors(robot_key(0), START, 1e4 * np.eye(6)), gtsam.Values()
    objects = PLACES if not spaces.are_alike else np.column_stack([PLACES, np.tile(so3.exp(np.ones(3)), (2, 1))])
    for number, state in enumerate(objects):
        spaces.landmark.insert(values, object_key(number), state)
    x = START
    for k in range(4):
        spaces.robot.insert(values, robot_key(k), x)
        if k:
            factors.append(
                spaces.robot.between_factor(
                    robot_key(k - 1), robot_key(k), STEP, (1e-10 if gravity else 1e-4) * np.eye(6)
                )
            )
        if gravity and k < 3:
            factors.append(Gravity(so3.matrix(x[3:])[2], 1e-4).factor(robot_key(k)))
        for number, state in enumerate(objects):
            keys = robot_key(k), object_key(number)
            if spaces.are_alike:
                factors.append(spaces.robot.between_factor(*keys, se3.between(x, state), 1e-4 * np.eye(6)))
            else:
                factors.append(SpatialObservation().geometry_factor(ray_to(x, state), keys))
        x = se3.compose(x, STEP)
    return factors, values


def ray_to(x: Array, place: Array) -> SpatialDetection:
    """A ray alone from a robot to a point."""
    away = so3.rotated(so3.inverse(x[3:]), place - x[:3])
    return SpatialDetection(ray=away / np.linalg.norm(away), range_m=np.nan, covariance=np.diag([np.nan, 1e-4, 1e-4]))


def summarised(spaces: Spaces, **others: bool) -> tuple[Summary, gtsam.Values]:
    """The flight without its first three poses, and where it is."""
    factors, values = flight(spaces, **others)
    gone = [robot_key(k) for k in range(3)]
    touched = [factor for factor in factors if not set(gone).isdisjoint(factor.keys())]
    anchors = {} if spaces.are_alike else {object_key(0): START[:3]}
    return summary_of(spaces, touched, values, gone, anchors), values


def moved(spaces: Spaces, summary: Summary, values: gtsam.Values, transform: Array) -> gtsam.Values:
    """The values of the summary's variables in a map that was moved."""
    found = gtsam.Values()
    for key in summary.keys:
        state = spaces.of(key).state(values, key)
        after = se3.compose(transform, state) if len(state) > 3 else transform[:3] + so3.rotated(transform[3:], state)
        spaces.of(key).insert(found, key, after)
    return found


@pytest.mark.parametrize("spaces", [POSES_AND_POINTS_IN_SPACE, POSES_IN_SPACE])
def test_a_map_that_turns_bends_no_summary(spaces: Spaces) -> None:
    """Neither points seen by rays nor poses; the Jacobian at the turned map is that by differences."""
    summary, values = summarised(spaces)
    factor = summary.factor(spaces)
    assert factor.error(values) == pytest.approx(0.0, abs=1e-12)
    turned = moved(spaces, summary, values, se3.exp(np.array([0.4, -1.0, 0.8, 3.0, -5.0, 2.0])))
    assert factor.error(turned) < 0.02  # what is known of where the map is: next to nothing
    turned = turned.retract(shifted(summary, turned, lambda size: 0.05 * np.sin(np.arange(size))))
    jacobian, right = factor.linearize(turned).jacobian()
    assert factor.error(turned) == pytest.approx(0.5 * right @ right)
    by_difference = np.empty_like(jacobian)
    for column in range(jacobian.shape[1]):
        ends = [
            factor.linearize(turned.retract(shifted(summary, turned, lambda size, h=h, c=column: h * np.eye(size)[c])))
            for h in (1e-5, -1e-5)
        ]
        by_difference[:, column] = (ends[1].jacobian()[1] - ends[0].jacobian()[1]) / 2e-5
    assert jacobian == pytest.approx(by_difference, abs=1e-3 * np.abs(jacobian).max())


def shifted(summary: Summary, values: gtsam.Values, step: Callable[[int], Array]) -> gtsam.VectorValues:
    """A step of all of a summary's variables, of so many components."""
    sizes = [values.extract([key]).dim() for key in summary.keys]
    parts = np.split(step(sum(sizes)), np.cumsum(sizes)[:-1])
    found = gtsam.VectorValues()
    for key, part in zip(summary.keys, parts, strict=True):
        found.insert(key, part)
    return found


def test_gravity_of_long_ago_holds_roll_and_pitch_and_leaves_the_heading_free() -> None:
    summary, values = summarised(POSES_AND_POINTS_IN_SPACE, gravity=True)
    factor = summary.factor(POSES_AND_POINTS_IN_SPACE)
    turns = np.array([[0.0, 0.0, 2.0], [0.05, 0.0, 0.0], [0.0, 0.05, 0.0]])
    every = [np.append(np.zeros(3), so3.exp(turn)) for turn in turns]
    yaw, *tilts = (factor.error(moved(POSES_AND_POINTS_IN_SPACE, summary, values, turn)) for turn in every)
    assert yaw < 0.02
    assert tilts == pytest.approx([0.5 * 3 * (0.05 / 0.01) ** 2] * 2, rel=0.02)  # three measurements of a hundredth


def test_rays_of_poses_that_are_known_are_summarised_whatever_the_range() -> None:
    """From poses that do not err against the one that stays, in inverse range: that is their own error everywhere."""
    spaces, key = POSES_AND_POINTS_IN_SPACE, object_key(0)
    place, factors, values = np.array([1.2, 0.1, 0.0]), [], gtsam.Values()
    model, robots = SpatialObservation(), [np.array([0.0, 0.03 * k, 0.02 * k, 0.0, 0.0, 0.0, 1.0]) for k in range(4)]
    for k, x in enumerate(robots):
        spaces.robot.insert(values, robot_key(k), x)
        factors.append(model.geometry_factor(ray_to(x, place), (robot_key(k), key)))
        if k:
            covariance = 1e-14 * np.eye(6)
            factors.append(
                spaces.robot.between_factor(robot_key(k - 1), robot_key(k), se3.between(robots[k - 1], x), covariance)
            )
    spaces.landmark.insert(values, key, place)
    gone = [robot_key(k) for k in range(3)]
    touched = [factor for factor in factors if not set(gone).isdisjoint(factor.keys())]
    known, blind = (
        summary_of(spaces, touched, values, gone, anchors).factor(spaces) for anchors in ({key: np.zeros(3)}, {})
    )
    for reach, aside in ((0.6, 0.01), (2.5, 0.0), (5.0, -0.05)):
        there = gtsam.Values(values)
        there.update(key, reach * np.array([1.0, aside, 0.02]))
        exact = sum(factor.error(there) for factor in touched)
        assert known.error(there) == pytest.approx(exact, rel=0.02, abs=0.02)
        assert blind.error(there) != pytest.approx(exact, rel=0.2)


def test_a_point_behind_the_camera_is_far_off_but_a_number() -> None:
    before = np.array([1.0, 0.2, 0.0])
    near, behind = (np.linalg.norm(inverse_range(before, scale * before)[0]) for scale in (0.011, -1.0))
    assert behind > near > 50.0
    deviation, slopes = inverse_range(before, before)
    np.testing.assert_allclose(deviation, 0.0, atol=1e-15)
    np.testing.assert_allclose(slopes, np.eye(3), atol=1e-15)


def test_of_a_flight_of_long_ago_looks_to_both_sides_of_a_place_count() -> None:
    """Also from places that differ in height alone."""
    turns = so3.exp(np.array([[0.0, 0.0, 0.1], [0.0, 0.0, 1.7]]))
    places = np.array([[0.1, 0.1, 0.1], [0.1, 0.1, 1.1]])
    kinds = np.array([np.append(place, turn) for place in places for turn in turns])
    trail = np.tile(kinds, (50, 1))
    prior = GaussianPrior(mean=trail[-1], covariance=np.eye(6))
    tracked = TrackedStates(
        states=np.zeros((0, 3)),
        covariances=np.zeros((0, 3, 3)),
        sigmas=np.zeros(0),
        robot=prior.mean,
        robot_covariance=prior.covariance,
        trail=trail,
    )
    thinned = tracked.with_thinned_trail(2).trail
    np.testing.assert_array_equal(thinned, trail[-len(kinds) * LOOKS_FROM_A_PLACE :])
