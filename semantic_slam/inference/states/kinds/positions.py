"""Positions, the vector space R^n, as a state space: the common base for the plane and for space."""

from typing import Any, ClassVar

import gtsam
import numpy as np

from semantic_slam.geometry.arrays import Array, broadcast_copy


class Positions:
    """R^n: x, y and further axes [m]; subclasses state the dimension and the GTSAM types."""

    tangent_size: int
    storage_size: int
    frame_size: int
    heading: ClassVar[int | None] = None
    own_turn: ClassVar[int | None] = None
    attitude: ClassVar[slice | None] = None
    prior: ClassVar[Any]  # GTSAM's factors
    between_points: ClassVar[Any]

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

    def vertical(self, state: Array) -> Array:
        return np.zeros(state.shape)

    def mean(self, states: Array, weights: Array) -> Array:
        return np.asarray(np.tensordot(weights, states, 1))

    def exp(self, tangent: Array) -> Array:
        return tangent

    def exp_and_jacobian(self, tangent: Array) -> tuple[Array, Array]:
        return tangent, self._identity(tangent)

    def propagation(self, control: Array) -> Array:
        return self._identity(control)

    def position(self, state: Array) -> Array:
        return state

    def position_slopes(self, state: Array) -> Array:
        return self._identity(state)

    def displacement(self, state: Array, point: Array, origin: Array) -> Array:
        size = self.storage_size
        moved = np.empty((*np.broadcast_shapes(state.shape[:-1], point.shape[:-1]), point.shape[-1]))
        moved[..., :size], moved[..., size:] = state - origin + point[..., :size], point[..., size:]
        return moved

    def turned_back(self, state: Array, vector: Array) -> Array:
        return vector

    def in_frame(self, state: Array, point: Array) -> tuple[Array, Array, Array]:
        point_in_frame = point - state
        return point_in_frame, -self._identity(point_in_frame), self._identity(point_in_frame)

    def poses(self, states: Array) -> Array:
        """(..., 7) pose vectors of positions, without rotation."""
        poses = np.zeros((*states.shape[:-1], 7))
        poses[..., : self.storage_size], poses[..., 6] = states, 1.0
        return poses

    def covariances(self, states: Array, covariances: Array) -> Array:
        """(..., 6, 6) covariances; those of the rotation, which a point does not have, are 0."""
        full, size = np.zeros((*states.shape[:-1], 6, 6)), self.tangent_size
        full[..., :size, :size] = covariances
        return full

    def moments(self, states: Array, covariances: Array) -> Array:
        return self.covariances(states, covariances)

    def insert(self, values: gtsam.Values, key: int, state: Array) -> None:
        values.insert(key, np.asarray(state))

    def prior_factors(self, key: int, mean: Array, covariance: Array) -> list[Any]:
        return [self.prior(key, np.asarray(mean), gtsam.noiseModel.Gaussian.Covariance(covariance))]

    def between_factor(self, key: int, next_key: int, control: Array, covariance: Array) -> Any:
        noise = gtsam.noiseModel.Gaussian.Covariance(covariance)
        return self.between_points(key, next_key, np.asarray(control), noise)

    def _identity(self, like: Array) -> Array:
        size = self.tangent_size
        return broadcast_copy(np.eye(size), (*like.shape[:-1], size, size))
