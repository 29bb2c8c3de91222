"""How far the objects near a keyframe's detections are from the camera, and how well that is known."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from semantic_slam.geometry.arrays import Array, squared_norms
from semantic_slam.inference.evidence.keyframe_problem import PredictedBelief
from semantic_slam.inference.models.spatial.ray import distances
from semantic_slam.inference.states.spaces import Spaces


def log_ranges_of(spaces: Spaces, detections: Sequence[Any], predicted: PredictedBelief) -> tuple[Array, Array]:
    """(D, M + 1) logarithms of the ranges of M near objects and of what each of D detections starts; and variances."""
    size, width = spaces.layout.robot, spaces.storage.landmark
    robot, objects = predicted.mean[0, 0, : spaces.storage.robot], predicted.mean[0, 1:, :width]
    joint, own = predicted.pair_covariances()[0], slice(size, size + spaces.layout.landmark)
    logs, variances = (np.zeros((len(detections), len(objects) + 1)) for _ in range(2))
    for row, detection in enumerate(detections):
        camera = spaces.robot.displacement(robot, detection.sensor, np.zeros(3))
        away = spaces.landmark.position(objects) - camera
        reach = distances(away)
        along = np.einsum("ni,nij,nj->n", away, joint[:, own, own], away)
        logs[row, :-1], variances[row, :-1] = np.log(reach), along / np.maximum(squared_norms(away), 1e-12) / reach**2
        known = detection.log_range
        logs[row, -1], variances[row, -1] = known.mean, known.sigma**2
    return logs, variances
