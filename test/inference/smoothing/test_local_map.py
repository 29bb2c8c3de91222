"""The joint covariance that is carried from keyframe to keyframe, where estimates change under it."""

import numpy as np
import pytest

from semantic_slam.geometry import se2
from semantic_slam.inference.smoothing.local_map import LocalDetection, LocalMap
from semantic_slam.inference.states.layout import Layout

ROBOT, OBJECTS = np.array([1.0, -2.0, 0.4]), np.array([[3.0, 1.0, -0.7], [-1.0, 4.0, 2.0]])
MOVED_ROBOT, MOVED_OBJECTS = np.array([1.3, -2.1, 0.5]), np.array([[3.2, 0.7, -0.6], [-1.0, 4.3, 2.0]])


def of_the_whole_map(robot: np.ndarray, objects: np.ndarray, landmark: int) -> np.ndarray:
    """(3 + M l, 3) how robot and objects move, in their tangent spaces, with the frame of map."""
    slopes = [se2.adjoint(se2.inverse(robot))]
    for state in objects:
        turn = np.array([[1.0, 0.0, -state[1]], [0.0, 1.0, state[0]]])
        slopes.append(se2.adjoint(se2.inverse(state)) if landmark == 3 else turn)
    return np.concatenate(slopes)


@pytest.mark.parametrize("landmark", [2, 3], ids=["positions", "poses"])
def test_what_is_not_known_of_the_frame_of_map_stays_so_where_estimates_change(landmark: int) -> None:
    before, after = (
        of_the_whole_map(robot, objects, landmark)
        for robot, objects in ((ROBOT, OBJECTS), (MOVED_ROBOT, MOVED_OBJECTS))
    )
    local = LocalMap(
        layout=Layout(3, landmark),
        ids=np.array([4, 7]),
        robot=ROBOT,
        objects=OBJECTS[:, :landmark],
        covariance=before @ before.T,
    ).at(MOVED_ROBOT, MOVED_OBJECTS[:, :landmark])
    np.testing.assert_allclose(local.covariance, after @ after.T, atol=1e-12)


def test_a_robot_that_looks_again_and_again_does_not_learn_how_map_is_turned() -> None:
    """Estimates move about as they do; the filter that ignores it ends with a quarter of the variance."""
    random = np.random.default_rng(0)
    slopes = of_the_whole_map(ROBOT, OBJECTS, 3)
    spread = np.diag([0.5, 0.5, 0.1]) ** 2
    local = LocalMap(
        layout=Layout(3, 3),
        ids=np.array([4, 7]),
        robot=ROBOT,
        objects=OBJECTS,
        covariance=slopes @ spread @ slopes.T + 1e-4 * np.eye(9),
    )
    heading = local.covariance[2, 2]
    for _ in range(20):
        local = local.updated([_seen(local, 0), _seen(local, 1)])
        local = local.at(
            se2.retract(local.robot, 0.1 * random.normal(size=3)),
            se2.retract(local.objects, 0.1 * random.normal(size=(2, 3))),
        )
    assert local.covariance[2, 2] > 0.95 * heading


def test_objects_that_are_given_up_leave() -> None:
    root = np.random.default_rng(1).normal(size=(10, 10))
    covariance = root @ root.T
    local = LocalMap(
        layout=Layout(3, 3),
        ids=np.array([4, 7]),
        robot=ROBOT,
        objects=OBJECTS,
        covariance=covariance,
        num_biases=1,
    ).without(np.array([True, False]))
    rows = [0, 1, 2, 3, 7, 8, 9]
    assert local.ids.tolist() == [7]
    np.testing.assert_array_equal(local.covariance, covariance[np.ix_(rows, rows)])
    np.testing.assert_array_equal(local.objects, OBJECTS[1:])


def test_only_objects_that_are_still_known_are_moved_to_their_estimates() -> None:
    local = _with_two_errors()
    ids, estimates = np.array([2, 5, 7]), np.array([[9.0, 9.0, 0.0], [8.0, 8.0, 0.0], MOVED_OBJECTS[1]])
    left = local.at_estimates(ids, MOVED_ROBOT, estimates)
    expected = local.without(np.array([True, False])).at(MOVED_ROBOT, MOVED_OBJECTS[1:])
    assert left.ids.tolist() == [7]
    np.testing.assert_array_equal(left.objects, MOVED_OBJECTS[1:])
    np.testing.assert_array_equal(left.covariance, expected.covariance)
    assert local.at_estimates(np.array([], dtype=int), MOVED_ROBOT, np.zeros((0, 3))).ids.tolist() == []


def test_detections_of_several_objects_and_their_errors_update_as_one_measurement() -> None:
    local, random = _with_two_errors(), np.random.default_rng(1)
    seen = [
        LocalDetection(number, *(random.normal(size=(2, width)) for width in (3, 3, 2)))
        for number in (7, 4)  # not in the order of the map
    ]
    slopes = np.zeros((4, 11))
    for rows, own, landmark in zip((slice(0, 2), slice(2, 4)), seen, (slice(8, 11), slice(5, 8)), strict=True):
        slopes[rows, :3], slopes[rows, 3:5], slopes[rows, landmark] = own.by_robot, own.by_errors, own.by_object
    information = np.linalg.inv(local.covariance) + slopes.T @ slopes
    np.testing.assert_allclose(local.updated(seen).covariance, np.linalg.inv(information), atol=1e-9)


def test_errors_of_the_next_frame_are_correlated_with_all_that_the_last_ones_were() -> None:
    local, random = _with_two_errors(), np.random.default_rng(2)
    matrix = random.normal(size=(4, 2))
    change = np.zeros((13, 11))
    change[:3, :3], change[3:7, 3:5], change[7:, 5:] = np.eye(3), matrix, np.eye(6)
    expected = change @ local.covariance @ change.T
    expected[3:7, 3:7] += 0.1 * np.eye(4)
    after = local.with_errors(matrix, 0.1 * np.eye(4))
    np.testing.assert_allclose(after.covariance, expected, atol=1e-12)
    assert after.num_errors == 4


def _with_two_errors() -> LocalMap:
    """A map of two poses, with the correlated errors of one detection."""
    root = np.random.default_rng(0).normal(size=(11, 11))
    return LocalMap(
        layout=Layout(3, 3), ids=np.array([4, 7]), robot=ROBOT, objects=OBJECTS, covariance=root @ root.T, num_errors=2
    )


def _seen(local: LocalMap, number: int) -> LocalDetection:
    """A position in the body frame, to a decimetre."""
    seen = se2.between(local.robot, local.objects[number])
    by_robot = np.array([[-1.0, 0.0, seen[1]], [0.0, -1.0, -seen[0]]])
    cos, sin = np.cos(seen[2]), np.sin(seen[2])
    by_object = np.array([[cos, -sin, 0.0], [sin, cos, 0.0]])
    return LocalDetection(int(local.ids[number]), 10.0 * by_robot, 10.0 * by_object, np.zeros((2, 0)))
