"""Viewpoints of candidates on their objects, in discrete steps, so that hypotheses that agree share computation."""

from typing import NamedTuple

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.models.planar.frames import camera_bearing, camera_distance
from semantic_slam.inference.models.spatial.ray import distances
from semantic_slam.inference.semantics.interface import SemanticInput
from semantic_slam.inference.states.spaces import viewpoints_of
from semantic_slam.viewpoint.labels.confusion import DIRECTIONS, STEP_RAD

LEAST_RANGE_M = 0.05
"""Range below which views count as from there."""
WIDEST = 2.0
"""Standard deviation of the log range above which the range counts as unknown."""


class ViewSteps(NamedTuple):
    """A viewpoint on an object in steps of ``STEP_RAD``, of angles and of the logarithm of the range alike."""

    direction: int  # azimuth of the direction from object to camera in map, one of DIRECTIONS cells
    log_range: int  # logarithm of their distance [m]
    range_sigma: int  # its standard deviation; 0 in the plane, where ranges are well known
    elevation: int  # of the direction; 0 in the plane


def view_steps(given: SemanticInput) -> Index:
    """(K, n, 4) viewpoints of K candidates on each of n objects as :class:`ViewSteps`; 0 where there is none."""
    robot, objects = _states(given)
    told = [given.step.detections[index].sensor for index in given.used.tolist()]
    rows, numbers = np.nonzero(given.candidates.assignments.objects >= 0)
    robots, seen = robot[rows], objects[rows, numbers]
    spaces, steps = given.parents[0].spaces, np.zeros((*objects.shape[:2], 4), dtype=int)
    if spaces.name == "spatial":
        places = seen[:, : spaces.storage.landmark]  # rows of a stack are as wide as the wider kind
        cameras = np.array(told).reshape(-1, 3)[numbers]
        from_here = viewpoints_of(spaces.robot.displacement(robots, cameras, spaces.landmark.position(places)))
        bearing, away = from_here.azimuth_rad, from_here.range_m
        sigma = np.sqrt(_range_variances(given, (rows, numbers), robots, places, cameras))
        wide = sigma / np.maximum(away, LEAST_RANGE_M)
        steps[rows, numbers, 2] = np.ceil(np.minimum(wide, WIDEST) / STEP_RAD)
        steps[rows, numbers, 3] = np.rint(from_here.elevation_rad / STEP_RAD)
    else:
        sensors = np.array(told).reshape(-1, 2)[numbers]
        bearing = camera_bearing(robots, seen, sensors)
        away = camera_distance(robots, seen, sensors)
    found = np.rint(np.array([bearing, np.log(np.maximum(away, LEAST_RANGE_M))]) / STEP_RAD)
    found[0] %= DIRECTIONS
    steps[rows, numbers, :2] = found.T
    return steps


def _range_variances(
    given: SemanticInput, at: tuple[Index, Index], robots: Array, places: Array, cameras: Array
) -> Array:
    """(m,) [m^2] of the distances from cameras (m, 3) of ``robots`` to ``places``, at rows and detections ``at``.

    What is unknown of both alike, such as the drift of the map, does not count.
    """
    table, relative = given.candidates.assignments, given.parents[0].spaces.relative_position(robots, places)
    away = relative.point - cameras
    along = (away / distances(away)[:, None])[:, None]
    by_robot, by_object = along @ relative.by_robot, along @ relative.by_landmark
    own, both = by_robot @ table.column("robot_covariance")[at[0]], by_robot @ table.column("object_crosses")[at]
    of_object = by_object @ table.column("object_covariances")[at] + 2.0 * both
    found = own @ np.swapaxes(by_robot, 1, 2) + of_object @ np.swapaxes(by_object, 1, 2)
    return np.maximum(found[:, 0, 0], 0.0)


def _states(given: SemanticInput) -> tuple[Array, Array]:
    """(K, 3) robots and (K, n, 2 or 3) objects of the detections at the modes, however the candidates were weighed."""
    rows = given.candidates.assignments
    if given.candidates.problem is None:
        return rows.column("robot"), rows.column("object_states")
    stack, states = given.stack, given.stack.states(given.mode.y)
    objects = states[np.arange(len(states))[:, None], 1 + stack.slots]
    return stack.robots_of(states), objects
