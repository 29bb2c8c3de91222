"""Ranges of the objects near a keyframe's detections, with their uncertainty."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from semantic_slam.geometry.arrays import Array, squared_norms
from semantic_slam.inference.models.spatial.ray import distances
from semantic_slam.inference.states.spaces import Spaces


def log_ranges_of(
    spaces: Spaces, detections: Sequence[Any], robot: Array, objects: Array, covariances: Array
) -> tuple[Array, Array]:
    """(D, M) log ranges of ``objects`` (M, l) from each detection's camera on a ``robot`` (s,), and their variances.

    ``covariances`` (M, 3, 3) are those of the objects' positions relative to the robot, along the axes of map.
    """
    sensors = np.array([detection.sensor for detection in detections]).reshape(-1, 3)
    away = spaces.landmark.position(objects) - spaces.robot.displacement(robot, sensors, np.zeros(3))[:, None]
    reach = distances(away)
    along = np.einsum("dni,nij,dnj->dn", away, covariances, away)
    return np.log(reach), along / np.maximum(squared_norms(away), 1e-12) / reach**2


def relative_covariances(spaces: Spaces, robot: Array, objects: Array, covariances: Array) -> Array:
    """(M, 3, 3) covariances of positions of ``objects`` (M, l) relative to a ``robot`` (s,), along the axes of map.

    From the joint ``covariances`` (M, r + l, r + l) of the robot with each object.
    """
    by_robot = np.tile(-spaces.robot.position_slopes(robot), (len(objects), 1, 1))
    slopes = np.concatenate([by_robot, spaces.landmark.position_slopes(objects)], axis=2)
    return np.asarray(slopes @ covariances @ np.swapaxes(slopes, 1, 2))
