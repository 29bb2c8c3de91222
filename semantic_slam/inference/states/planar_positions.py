"""Planar positions, the vector space R^2, as a state space: of points, and of problems with closed forms."""

from dataclasses import dataclass
from typing import Any, ClassVar

import gtsam
import numpy as np

from semantic_slam.geometry.arrays import Array


@dataclass(frozen=True)
class PlanarPositions:
    """R^2: x, y [m]. With linear models every belief of the engine is exact here."""

    tangent_size = 2
    storage_size = 2
    frame_size = 2
    heading: ClassVar[int | None] = None
    origin = np.full(2, 0.7)
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
        return tangent, _identity(tangent)

    def propagation(self, control: Array) -> Array:
        return _identity(control)

    def position(self, state: Array) -> Array:
        return state

    def position_slopes(self, state: Array) -> Array:
        return _identity(state)

    def displacement(self, state: Array, point: Array, origin: Array) -> Array:
        moved = np.empty((*np.broadcast_shapes(state.shape[:-1], point.shape[:-1]), point.shape[-1]))
        moved[..., :2], moved[..., 2:] = state - origin + point[..., :2], point[..., 2:]
        return moved

    def turned_back(self, state: Array, vector: Array) -> Array:
        return vector

    def in_frame(self, state: Array, point: Array) -> tuple[Array, Array, Array]:
        point_in_frame = point - state
        return point_in_frame, -_identity(point_in_frame), _identity(point_in_frame)

    def poses(self, states: Array) -> Array:
        """(..., 7) pose vectors of positions, without rotation."""
        poses = np.zeros((*states.shape[:-1], 7))
        poses[..., :2], poses[..., 6] = states, 1.0
        return poses

    def covariances(self, states: Array, covariances: Array) -> Array:
        """The directions, of which a point has none, are 0."""
        full = np.zeros((*states.shape[:-1], 6, 6))
        full[..., :2, :2] = covariances
        return full

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


def _identity(like: Array) -> Array:
    return np.broadcast_to(np.eye(2), (*like.shape[:-1], 2, 2))
