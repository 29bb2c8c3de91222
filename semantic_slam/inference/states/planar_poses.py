"""Planar poses, SE(2), as a state space."""

from typing import Any

import gtsam
import numpy as np

from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array


class PlanarPoses:
    """SE(2): x, y [m], yaw [rad]."""

    dimension = 3
    relinearize_threshold = np.array([0.1, 0.1, 0.05])
    far = np.array([5.0, 5.0, 0.1])

    def compose(self, state: Array, control: Array) -> Array:
        return se2.compose(state, control)

    def frame(self, state: Array) -> Array:
        return se2.frame(state)

    def placed(self, frame: Array, control: Array) -> Array:
        return se2.placed(frame, control)

    def along(self, start: Array, controls: Array) -> Array:
        return se2.along(start, controls)

    def wrapped(self, state: Array) -> Array:
        return se2.wrapped(state)

    def retract(self, state: Array, tangent: Array) -> Array:
        return se2.retract(state, tangent)

    def local(self, state: Array, other: Array) -> Array:
        return se2.log(se2.between(state, other))

    def between(self, state: Array, other: Array) -> Array:
        return se2.between(state, other)

    def mean(self, states: Array, weights: Array) -> Array:
        heading = np.arctan2(weights @ np.sin(states[..., 2]), weights @ np.cos(states[..., 2]))
        return np.concatenate([np.tensordot(weights, states[..., :2], 1), heading[..., None]], axis=-1)

    def exp(self, tangent: Array) -> Array:
        return se2.exp(tangent)

    def exp_and_jacobian(self, tangent: Array) -> tuple[Array, Array]:
        return se2.exp_and_jacobian(tangent)

    def propagation(self, control: Array) -> Array:
        return se2.inverse_adjoint(control)

    def insert(self, values: gtsam.Values, key: int, state: Array) -> None:
        values.insert(key, gtsam.Pose2(*state.tolist()))

    def state(self, values: gtsam.Values, key: int) -> Array:
        pose = values.atPose2(key)
        return np.array([pose.x(), pose.y(), pose.theta()])

    def states(self, values: gtsam.Values) -> Array:
        return np.asarray(gtsam.utilities.extractPose2(values))

    def prior_factor(self, key: int, mean: Array, covariance: Array) -> Any:
        return gtsam.PriorFactorPose2(key, gtsam.Pose2(*mean), gtsam.noiseModel.Gaussian.Covariance(covariance))

    def between_factor(self, key: int, next_key: int, control: Array, covariance: Array) -> Any:
        noise = gtsam.noiseModel.Gaussian.Covariance(covariance)
        return gtsam.BetweenFactorPose2(key, next_key, gtsam.Pose2(*control), noise)
