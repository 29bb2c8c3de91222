"""Planar poses, SE(2), as a state space."""

from dataclasses import dataclass
from typing import Any, ClassVar

import gtsam
import numpy as np

from semantic_slam.geometry import arc_moments, se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import covariance_from_planar, pose_vector_from_planar


@dataclass(frozen=True)
class PlanarPoses:
    """SE(2): x, y [m], yaw [rad]."""

    tangent_size = 3
    storage_size = 3
    frame_size = 5
    heading: ClassVar[int | None] = 2
    own_turn: ClassVar[int | None] = 2
    attitude: ClassVar[slice | None] = None
    position_rows = slice(0, 2)
    origin = np.full(3, 0.7)
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

    def vertical(self, state: Array) -> Array:
        return np.broadcast_to([0.0, 0.0, 1.0], state.shape)

    def mean(self, states: Array, weights: Array) -> Array:
        heading = np.arctan2(weights @ np.sin(states[..., 2]), weights @ np.cos(states[..., 2]))
        return np.concatenate([np.tensordot(weights, states[..., :2], 1), heading[..., None]], axis=-1)

    def exp(self, tangent: Array) -> Array:
        return se2.exp(tangent)

    def exp_and_jacobian(self, tangent: Array) -> tuple[Array, Array]:
        return se2.exp_and_jacobian(tangent)

    def propagation(self, control: Array) -> Array:
        return se2.inverse_adjoint(control)

    def position(self, state: Array) -> Array:
        return state[..., :2]

    def position_slopes(self, state: Array) -> Array:
        slopes = np.zeros((*state.shape[:-1], 2, 3))
        sin, cos = se2.sine_cosine(state[..., 2])
        slopes[..., 0, 0], slopes[..., 0, 1], slopes[..., 1, 0], slopes[..., 1, 1] = cos, -sin, sin, cos
        return slopes

    def displacement(self, state: Array, point: Array, origin: Array) -> Array:
        ahead, left = state[..., 0] - origin[..., 0], state[..., 1] - origin[..., 1]
        if point.any():
            sin, cos = se2.sine_cosine(state[..., 2])
            ahead = ahead + cos * point[..., 0] - sin * point[..., 1]
            left = left + sin * point[..., 0] + cos * point[..., 1]
        return _beside(ahead, left, point)

    def turned_back(self, state: Array, vector: Array) -> Array:
        sin, cos = se2.sine_cosine(state[..., 2])
        x, y = vector[..., 0], vector[..., 1]
        return _beside(cos * x + sin * y, cos * y - sin * x, vector)

    def in_frame(self, state: Array, point: Array) -> tuple[Array, Array, Array]:
        sin, cos = se2.sine_cosine(state[..., 2])
        point_in_frame = self.turned_back(state, point - state[..., :2])
        by_point = np.empty((*point_in_frame.shape, 2))
        by_point[..., 0, 0], by_point[..., 0, 1], by_point[..., 1, 0], by_point[..., 1, 1] = cos, sin, -sin, cos
        by_state = np.zeros((*point_in_frame.shape, 3))  # [-I, -S seen]
        by_state[..., 0, 0] = by_state[..., 1, 1] = -1.0
        by_state[..., 0, 2], by_state[..., 1, 2] = point_in_frame[..., 1], -point_in_frame[..., 0]
        return point_in_frame, by_state, by_point

    def poses(self, states: Array) -> Array:
        return pose_vector_from_planar(states)

    def covariances(self, states: Array, covariances: Array) -> Array:
        return covariance_from_planar(se2.rotate_covariance(states, covariances))

    def moments(self, states: Array, covariances: Array) -> Array:
        return covariance_from_planar(arc_moments.planar(states, covariances))

    def insert(self, values: gtsam.Values, key: int, state: Array) -> None:
        values.insert(key, gtsam.Pose2(*state.tolist()))

    def state(self, values: gtsam.Values, key: int) -> Array:
        pose = values.atPose2(key)
        return np.array([pose.x(), pose.y(), pose.theta()])

    def states(self, values: gtsam.Values) -> Array:
        return np.asarray(gtsam.utilities.extractPose2(values))

    def prior_factors(self, key: int, mean: Array, covariance: Array) -> list[Any]:
        return [gtsam.PriorFactorPose2(key, gtsam.Pose2(*mean), gtsam.noiseModel.Gaussian.Covariance(covariance))]

    def between_factor(self, key: int, next_key: int, control: Array, covariance: Array) -> Any:
        noise = gtsam.noiseModel.Gaussian.Covariance(covariance)
        return gtsam.BetweenFactorPose2(key, next_key, gtsam.Pose2(*control), noise)


def _beside(ahead: Array, left: Array, like: Array) -> Array:
    """(..., q) of two components, and of the heights in ``like`` (..., q), which no yaw changes."""
    vector = np.empty((*np.shape(ahead), like.shape[-1]))
    vector[..., 0], vector[..., 1], vector[..., 2:] = ahead, left, like[..., 2:]
    return vector
