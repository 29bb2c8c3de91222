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

    ``covariances`` (M, l, l) are those of the objects.
    """
    logs, variances = (np.zeros((len(detections), len(objects))) for _ in range(2))
    for row, detection in enumerate(detections):
        camera = spaces.robot.displacement(robot, detection.sensor, np.zeros(3))
        away = spaces.landmark.position(objects) - camera
        reach = distances(away)
        along = np.einsum("ni,nij,nj->n", away, covariances, away)
        logs[row], variances[row] = np.log(reach), along / np.maximum(squared_norms(away), 1e-12) / reach**2
    return logs, variances
