"""Poses of objects in space, whose attitudes do not bend the errors of their positions."""

from dataclasses import dataclass
from typing import Any

import gtsam
import numpy as np

from semantic_slam.geometry import se3, so3
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.states.kinds.planar_objects import ANYWHERE_M
from semantic_slam.inference.states.kinds.spatial_poses import SpatialPoses, gtsam_pose


@dataclass(frozen=True)
class SpatialObjects(SpatialPoses):
    """Poses in the chart SO(3) x R^3: a tangent vector turns an attitude by w and moves a position by R v.

    An attitude that nobody knows, such as a yaw, then does not bend the errors of a position that is well known.
    """

    def retract(self, state: Array, tangent: Array) -> Array:
        return se3.compose(state, self.exp(tangent))

    def local(self, state: Array, other: Array) -> Array:
        return _local(se3.between(state, other))

    def exp(self, tangent: Array) -> Array:
        return np.concatenate([tangent[..., se3.TRANSLATION], so3.exp(tangent[..., se3.ROTATION])], axis=-1)

    def exp_and_jacobian(self, tangent: Array) -> tuple[Array, Array]:
        moved = self.exp(tangent)
        return moved, _slopes(tangent[..., se3.ROTATION], moved[..., 3:])

    def moments(self, states: Array, covariances: Array) -> Array:
        return self.covariances(states, covariances)

    def prior_factors(self, key: int, mean: Array, covariance: Array) -> list[Any]:
        """Priors of position and attitude apart; where they are correlated, one in SE(3)'s chart, as GTSAM has it."""
        if covariance[se3.ROTATION, se3.TRANSLATION].any():
            return super().prior_factors(key, mean, covariance)
        turn = so3.matrix(mean[3:])
        position = gtsam.noiseModel.Gaussian.Covariance(turn @ covariance[se3.TRANSLATION, se3.TRANSLATION] @ turn.T)
        spread = np.diag([0.0] * 3 + [ANYWHERE_M**2] * 3)
        spread[se3.ROTATION, se3.ROTATION] = covariance[se3.ROTATION, se3.ROTATION]
        attitude = gtsam.noiseModel.Gaussian.Covariance(spread)
        pose = gtsam_pose(mean)
        return [gtsam.PoseTranslationPrior3D(key, pose, position), gtsam.PriorFactorPose3(key, pose, attitude)]


@dataclass(frozen=True)
class SpatialPosesAmongObjects(SpatialPoses):
    """Arithmetic over (..., N, 7) poses in space: objects in the rows from 1 up to ``end`` (None: all), else robots."""

    end: int | None = None

    def retract(self, state: Array, tangent: Array) -> Array:
        return se3.compose(state, self.exp(tangent))

    def local(self, state: Array, other: Array) -> Array:
        relative = se3.between(state, other)
        found = se3.log(relative)
        found[..., 1 : self.end, se3.TRANSLATION] = relative[..., 1 : self.end, :3]
        return found

    def exp(self, tangent: Array) -> Array:
        found = se3.exp(tangent)
        found[..., 1 : self.end, :3] = tangent[..., 1 : self.end, se3.TRANSLATION]
        return found

    def exp_and_jacobian(self, tangent: Array) -> tuple[Array, Array]:
        found, chart = se3.exp_and_jacobian(tangent)
        objects = tangent[..., 1 : self.end, :]
        found[..., 1 : self.end, :3] = objects[..., se3.TRANSLATION]
        chart[..., 1 : self.end, :, :] = _slopes(objects[..., se3.ROTATION], found[..., 1 : self.end, 3:])
        return found, chart


def _local(relative: Array) -> Array:
    return np.concatenate([so3.log(relative[..., 3:]), relative[..., :3]], axis=-1)


def _slopes(turn: Array, attitude: Array) -> Array:
    """(..., 6, 6) slopes of the chart at rotation vectors (..., 3), which are quaternions ``attitude`` (..., 4)."""
    slopes = np.zeros((*turn.shape[:-1], 6, 6))
    slopes[..., se3.ROTATION, se3.ROTATION] = so3.right_jacobian(turn)
    slopes[..., se3.TRANSLATION, se3.TRANSLATION] = np.swapaxes(so3.matrix(attitude), -1, -2)
    return slopes
