"""GTSAM factors between X(k), O(n) and the descriptor E(n).

The exact factor calls back into Python wherever iSAM2 linearises it, a linear one is made once for all of a keyframe
in one batch and stays true near those states only.
"""

from collections.abc import Sequence
from typing import Any

import gtsam
import numpy as np
from numpy.typing import NDArray

from semantic_slam.inference.latent_observation import LatentLinearisation, LatentObservation
from semantic_slam.inference.planar_detection import PlanarDetection, PlanarDetections
from semantic_slam.inference.planar_factors import unit_noise

Array = NDArray[np.float64]
Keys = tuple[int, int, int]
"""X(k), O(n), E(n)."""


def exact_factor(observation: LatentObservation, detection: PlanarDetection, keys: Keys) -> Any:
    """A CustomFactor; it cannot be pickled, but an iSAM2 that holds it can be forked."""
    seen = PlanarDetections.of([detection])

    def error(this: Any, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
        robot, target, descriptor = this.keys()
        x, o = _planar(values.atPose2(robot)), _planar(values.atPose2(target))
        part = observation.linearise(seen, x, o, np.asarray(values.atVector(descriptor))[None])
        if jacobians is not None:
            for slot, jacobian in enumerate((part.by_robot, part.by_object, part.by_descriptor)):
                jacobians[slot] = np.asfortranarray(jacobian[0])
        return np.asarray(part.residual[0])

    return gtsam.CustomFactor(unit_noise(observation.model.num_features), list(keys), error)


def linear_factors(part: LatentLinearisation, keys: Sequence[Keys], x: Array, o: Array, e: Array) -> list[Any]:
    """One factor for each row of a linearisation at (B, 3) robots and objects and (B, L) descriptors.

    A variable is at the same place in all of its rows.
    """
    noise, values = unit_noise(part.residual.shape[1]), _values(keys, x, o, e)
    rows = zip(keys, part.by_robot, part.by_object, part.by_descriptor, -part.residual, strict=True)
    return [
        gtsam.LinearContainerFactor(gtsam.JacobianFactor(k[0], robot, k[1], target, k[2], own, right, noise), values)
        for k, robot, target, own, right in rows
    ]


def _values(keys: Sequence[Keys], x: Array, o: Array, e: Array) -> gtsam.Values:
    """Every variable once; GTSAM takes plain floats several times faster."""
    poses: dict[int, list[float]] = {}
    descriptors: dict[int, Array] = {}
    for (robot, target, own), a, b, row in zip(keys, x.tolist(), o.tolist(), e, strict=True):
        poses[robot], poses[target], descriptors[own] = a, b, row
    values = gtsam.Values()
    for key, pose in poses.items():
        values.insert(key, gtsam.Pose2(*pose))
    for key, state in descriptors.items():
        values.insert(key, state)
    return values


def _planar(pose: Any) -> Array:
    return np.array([[pose.x(), pose.y(), pose.theta()]])
