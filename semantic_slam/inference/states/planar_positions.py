"""Planar positions, the vector space R^2, as a state space: for problems with closed forms."""

from typing import Any

import gtsam
import numpy as np

from semantic_slam.geometry.arrays import Array


class PlanarPositions:
    """R^2: x, y [m]. With linear models every belief of the engine is exact here."""

    dimension = 2
    relinearize_threshold = np.array([0.1, 0.1])
    far = np.array([5.0, 5.0])

    def compose(self, state: Array, control: Array) -> Array:
        return np.asarray(state + control)

    def frame(self, state: Array) -> Array:
        return state

    def placed(self, frame: Array, control: Array) -> Array:
        return np.asarray(frame + control)

    def along(self, start: Array, controls: Array) -> Array:
        return np.asarray(start[..., None, :] + np.cumsum(controls, axis=-2))

    def wrapped(self, state: Array) -> Array:
        return state

    def retract(self, state: Array, tangent: Array) -> Array:
        return np.asarray(state + tangent)

    def local(self, state: Array, other: Array) -> Array:
        return np.asarray(other - state)

    def between(self, state: Array, other: Array) -> Array:
        return np.asarray(other - state)

    def mean(self, states: Array, weights: Array) -> Array:
        return np.asarray(np.tensordot(weights, states, 1))

    def exp(self, tangent: Array) -> Array:
        return tangent

    def exp_and_jacobian(self, tangent: Array) -> tuple[Array, Array]:
        return tangent, np.broadcast_to(np.eye(2), (*tangent.shape[:-1], 2, 2))

    def propagation(self, control: Array) -> Array:
        return np.broadcast_to(np.eye(2), (*control.shape[:-1], 2, 2))

    def insert(self, values: gtsam.Values, key: int, state: Array) -> None:
        values.insert(key, np.asarray(state))

    def state(self, values: gtsam.Values, key: int) -> Array:
        return np.asarray(values.atPoint2(key))

    def states(self, values: gtsam.Values) -> Array:
        return np.asarray(gtsam.utilities.extractPoint2(values))

    def prior_factor(self, key: int, mean: Array, covariance: Array) -> Any:
        return gtsam.PriorFactorPoint2(key, np.asarray(mean), gtsam.noiseModel.Gaussian.Covariance(covariance))

    def between_factor(self, key: int, next_key: int, control: Array, covariance: Array) -> Any:
        noise = gtsam.noiseModel.Gaussian.Covariance(covariance)
        return gtsam.BetweenFactorPoint2(key, next_key, np.asarray(control), noise)
