"""Coordinates in which a summary of the past is Gaussian, in space: deviations of states relative to a robot pose.

The robot's own deviation is the exponential coordinate about where it was: a turn about the vertical, which neither
odometry nor gravity measures, then leaves roll and pitch as they were, and errors that odometry has added up are
Gaussian (Long et al., The Banana Distribution is Gaussian, 2012). Objects are points seen from the robot, with rotation
vectors where they have an attitude. A point that was first seen by a ray alone has direction and inverse range from
where that ray began, in which rays are nearly linear, however little is known of the range (Civera et al., Inverse
Depth Parametrization for Monocular SLAM, 2008).
"""

from collections.abc import Mapping, Sequence

import gtsam
import numpy as np

from semantic_slam.geometry import se3, so3
from semantic_slam.geometry.arrays import Array, squared_norms
from semantic_slam.inference.states.spaces import LEAST_DISTANCE_M, Spaces

NEAREST = 0.01
"""Least ratio of a range to the range before; an optimisation may try points behind the camera."""


def relative_states(spaces: Spaces, keys: Sequence[int], values: gtsam.Values) -> Array:
    """(q,) states of objects relative to the robot, then the robot's in map; its key is the last of ascending ones."""
    robot, objects = _states(spaces, keys, values)
    return np.append(spaces.seen(robot, objects), robot)


def seen_anchors(spaces: Spaces, robot: Array, anchors: Mapping[int, Array]) -> dict[int, Array]:
    """Ray origins (3,) by object key, from map to the frame of a robot (s,)."""
    space = spaces.robot
    return {key: space.turned_back(robot, anchor - space.position(robot)) for key, anchor in anchors.items()}


def deviations(
    spaces: Spaces, keys: Sequence[int], values: gtsam.Values, before: Array, anchors: Mapping[int, Array]
) -> tuple[Array, Array]:
    """(m,) deviations from the relative states ``before`` (q,), and their (m, m) Jacobian by tangent vectors.

    ``anchors`` (3,) in the robot's frame, by the keys of points that were first seen by rays alone.
    """
    robot, objects = _states(spaces, keys, values)
    told, told_robot = np.split(before, [-spaces.storage.robot])
    told = told.reshape(objects.shape)
    if spaces.are_alike:
        found, by_robot, by_object = _of_poses(spaces, robot, objects, told)
    else:
        found, by_robot, by_object = _of_points(spaces, robot, objects, told)
        _along_rays(keys, anchors, told, found, by_robot, by_object)
    moved = spaces.robot.local(told_robot, robot)
    own, size = found.size, spaces.layout.landmark
    slopes = np.zeros((own + len(moved), own + len(moved)))
    slopes[:own, own:] = by_robot.reshape(own, len(moved))
    slopes[own:, own:] = np.linalg.inv(spaces.robot.exp_and_jacobian(moved)[1])
    for number, block in enumerate(by_object):
        part = slice(number * size, (number + 1) * size)
        slopes[part, part] = block
    return np.append(found, moved), slopes


def _states(spaces: Spaces, keys: Sequence[int], values: gtsam.Values) -> tuple[Array, Array]:
    """(s,) the robot's state, and (n, s) those of the objects."""
    objects = [spaces.landmark.state(values, key) for key in keys[:-1]]
    return spaces.robot.state(values, keys[-1]), np.array(objects).reshape(-1, spaces.storage.landmark)


def _of_points(spaces: Spaces, robot: Array, objects: Array, before: Array) -> tuple[Array, Array, Array]:
    """(n, 3) deviations of points seen, with their Jacobians (n, 3, r) by the robot and (n, 3, l) by the objects."""
    seen = spaces.relative_position(robot, objects)
    return seen.point - before, seen.by_robot, seen.by_landmark


def _of_poses(spaces: Spaces, robot: Array, objects: Array, before: Array) -> tuple[Array, Array, Array]:
    """:func:`_of_points` for poses: rotation vectors, then points, as an attitude may be known much worse."""
    places, place_by_robot, place_by_object = _of_points(spaces, robot, objects, before[:, :3])
    seen = spaces.landmark.between(robot, objects)[:, 3:]
    turns = so3.log(so3.product(so3.inverse(before[:, 3:]), seen))
    by_robot, by_object = np.zeros((2, *places.shape[:1], 6, 6))
    turned = np.linalg.inv(so3.right_jacobian(turns))
    by_object[:, se3.ROTATION, se3.ROTATION] = turned
    by_robot[:, se3.ROTATION, se3.ROTATION] = -turned @ np.swapaxes(so3.matrix(seen), 1, 2)
    by_robot[:, se3.TRANSLATION], by_object[:, se3.TRANSLATION] = place_by_robot, place_by_object
    return np.concatenate([turns, places], axis=1), by_robot, by_object


def _along_rays(
    keys: Sequence[int], anchors: Mapping[int, Array], before: Array, found: Array, by_robot: Array, by_object: Array
) -> None:
    """Replace the deviations of points with an anchor by those in direction and inverse range, in place."""
    for number, key in enumerate(keys[:-1]):
        if key in anchors:
            away = before[number] - anchors[key]
            found[number], slopes = inverse_range(away, away + found[number])
            by_robot[number], by_object[number] = slopes @ by_robot[number], slopes @ by_object[number]


def inverse_range(before: Array, now: Array) -> tuple[Array, Array]:
    """(3,) deviation of a point ``now`` (3,) from one ``before``, both relative to an anchor, and its (3, 3) Jacobian.

    With u the direction and d the distance of the one before, and s d that of the point along u, the deviation is
    d (1 - 1 / s) along u, and aside where the ray to the point meets the plane across u at distance d. To first order
    it is the difference of both points.
    """
    distance = max(float(np.sqrt(squared_norms(before))), LEAST_DISTANCE_M)
    unit = before / distance
    ratio = float(now @ unit) / distance
    if ratio < NEAREST:
        return now / NEAREST - before + distance * (1.0 - 1.0 / NEAREST) * unit, np.eye(3) / NEAREST
    along = np.outer(unit, unit) / ratio
    slopes = (np.eye(3) - np.outer(now, unit) / (ratio * distance) + along) / ratio
    return now / ratio - before + distance * (1.0 - 1.0 / ratio) * unit, slopes
