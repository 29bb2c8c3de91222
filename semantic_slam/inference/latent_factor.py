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

    return gtsam.CustomFactor(_unit(observation.model.num_features), list(keys), error)


def linear_factors(part: LatentLinearisation, keys: Sequence[Keys], x: Array, o: Array, e: Array) -> list[Any]:
    """One factor for each row of a linearisation at (B, 3) robots and objects and (B, L) descriptors."""
    noise = _unit(part.residual.shape[1])
    return [_linear_factor(part, row, own, (x[row], o[row], e[row]), noise) for row, own in enumerate(keys)]


def _linear_factor(
    part: LatentLinearisation, row: int, keys: Keys, states: tuple[Array, Array, Array], noise: Any
) -> Any:
    values = gtsam.Values()
    values.insert(keys[0], gtsam.Pose2(*states[0]))
    values.insert(keys[1], gtsam.Pose2(*states[1]))
    values.insert(keys[2], states[2])
    by_robot, by_object, by_descriptor = (
        np.asfortranarray(value[row]) for value in (part.by_robot, part.by_object, part.by_descriptor)
    )
    linear = gtsam.JacobianFactor(
        keys[0], by_robot, keys[1], by_object, keys[2], by_descriptor, -part.residual[row], noise
    )
    return gtsam.LinearContainerFactor(linear, values)


def _unit(size: int) -> Any:
    return gtsam.noiseModel.Unit.Create(size)


def _planar(pose: Any) -> Array:
    return np.array([[pose.x(), pose.y(), pose.theta()]])
