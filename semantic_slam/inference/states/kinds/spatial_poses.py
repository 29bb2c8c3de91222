"""Poses in space, SE(3), as a state space."""

from dataclasses import dataclass
from typing import Any, ClassVar

import gtsam
import numpy as np

from semantic_slam.geometry import arc_moments, se3, so3
from semantic_slam.geometry.arrays import Array


@dataclass(frozen=True)
class SpatialPoses:
    """SE(3): x, y, z [m], quaternion; tangent vectors are [rotation, translation], as GTSAM's Pose3 has them."""

    tangent_size = 6
    storage_size = 7
    frame_size = 16
    heading: ClassVar[int | None] = None
    own_turn: ClassVar[int | None] = 2
    attitude: ClassVar[slice | None] = se3.ROTATION
    position_rows = se3.TRANSLATION
    origin = se3.exp(np.full(6, 0.7))
    relinearize_threshold = np.array([0.05, 0.05, 0.05, 0.1, 0.1, 0.1])
    far = np.array([0.1, 0.1, 0.1, 5.0, 5.0, 5.0])

    def compose(self, state: Array, control: Array) -> Array:
        return se3.compose(state, control)

    def frame(self, state: Array) -> Array:
        return se3.frame(state)

    def placed(self, frame: Array, control: Array) -> Array:
        return se3.placed(frame, control)

    def along(self, start: Array, controls: Array) -> Array:
        return se3.along(start, controls)

    def wrapped(self, state: Array) -> Array:
        return se3.wrapped(state)

    def retract(self, state: Array, tangent: Array) -> Array:
        return se3.retract(state, tangent)

    def local(self, state: Array, other: Array) -> Array:
        return se3.log(se3.between(state, other))

    def between(self, state: Array, other: Array) -> Array:
        return se3.between(state, other)

    def vertical(self, state: Array) -> Array:
        turn = np.zeros((*state.shape[:-1], 6))
        turn[..., se3.ROTATION] = so3.matrix(state[..., 3:])[..., 2, :]
        return turn

    def mean(self, states: Array, weights: Array) -> Array:
        return se3.mean(states, weights)

    def exp(self, tangent: Array) -> Array:
        return se3.exp(tangent)

    def exp_and_jacobian(self, tangent: Array) -> tuple[Array, Array]:
        return se3.exp_and_jacobian(tangent)

    def propagation(self, control: Array) -> Array:
        return se3.inverse_adjoint(control)

    def position(self, state: Array) -> Array:
        return state[..., :3]

    def position_slopes(self, state: Array) -> Array:
        slopes = np.zeros((*state.shape[:-1], 3, 6))
        slopes[..., se3.TRANSLATION] = so3.matrix(state[..., 3:])
        return slopes

    def displacement(self, state: Array, point: Array, origin: Array) -> Array:
        return np.asarray(state[..., :3] - origin + so3.rotated(state[..., 3:], point))

    def turned_back(self, state: Array, vector: Array) -> Array:
        return so3.rotated(so3.inverse(state[..., 3:]), vector)

    def in_frame(self, state: Array, point: Array) -> tuple[Array, Array, Array]:
        by_point = np.swapaxes(so3.matrix(state[..., 3:]), -1, -2)
        point_in_frame = (by_point @ (point - state[..., :3])[..., None])[..., 0]
        by_state = np.zeros((*point_in_frame.shape, 6))  # [hat(seen), -I]
        by_state[..., se3.ROTATION] = so3.hat(point_in_frame)
        by_state[..., [0, 1, 2], [3, 4, 5]] = -1.0
        return point_in_frame, by_state, by_point

    def poses(self, states: Array) -> Array:
        return se3.wrapped(states)

    def covariances(self, states: Array, covariances: Array) -> Array:
        return se3.covariance_along_parent(states, covariances)

    def moments(self, states: Array, covariances: Array) -> Array:
        return arc_moments.spatial(states, covariances)

    def insert(self, values: gtsam.Values, key: int, state: Array) -> None:
        values.insert(key, gtsam_pose(state))

    def state(self, values: gtsam.Values, key: int) -> Array:
        pose = values.atPose3(key)
        return np.concatenate([pose.translation(), so3.from_matrix(pose.rotation().matrix())])

    def states(self, values: gtsam.Values) -> Array:
        rows = np.asarray(gtsam.utilities.extractPose3(values))  # rotation row by row, then translation
        return np.concatenate([rows[:, 9:], so3.from_matrix(rows[:, :9].reshape(-1, 3, 3))], axis=1)

    def prior_factors(self, key: int, mean: Array, covariance: Array) -> list[Any]:
        return [gtsam.PriorFactorPose3(key, gtsam_pose(mean), gtsam.noiseModel.Gaussian.Covariance(covariance))]

    def between_factor(self, key: int, next_key: int, control: Array, covariance: Array) -> Any:
        noise = gtsam.noiseModel.Gaussian.Covariance(covariance)
        return gtsam.BetweenFactorPose3(key, next_key, gtsam_pose(control), noise)


def gtsam_pose(state: Array) -> gtsam.Pose3:
    """GTSAM's pose of a state (7,)."""
    qx, qy, qz, qw = state[3:].tolist()
    return gtsam.Pose3(gtsam.Rot3.Quaternion(qw, qx, qy, qz), np.asarray(state[:3]))
