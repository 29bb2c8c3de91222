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


def _seen(local: LocalMap, number: int) -> LocalDetection:
    """A position in the body frame, to a decimetre."""
    seen = se2.between(local.robot, local.objects[number])
    by_robot = np.array([[-1.0, 0.0, seen[1]], [0.0, -1.0, -seen[0]]])
    cos, sin = np.cos(seen[2]), np.sin(seen[2])
    by_object = np.array([[cos, -sin, 0.0], [sin, cos, 0.0]])
    return LocalDetection(int(local.ids[number]), 10.0 * by_robot, 10.0 * by_object, np.zeros((2, 0)))
