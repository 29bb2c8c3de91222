"""The three coordinates that joint covariances of mapped objects are over: x, y, yaw in the plane, x, y, z in space."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import PLANAR_AXES, planar_from_pose_vector, pose_vector_from_planar, wrap_angle


@dataclass(frozen=True)
class ObjectCoordinates:
    """Three of an object's coordinates in map, in metres and radians."""

    axes: tuple[int, int, int]  # their rows in a covariance over x y z rx ry rz
    has_yaw: bool  # whether the last one is a heading

    def of_poses(self, poses: Array) -> Array:
        """(..., 3) coordinates of poses (..., 7)."""
        return planar_from_pose_vector(poses) if self.has_yaw else np.asarray(poses, dtype=np.float64)[..., :3]

    def of_covariances(self, covariances: Array) -> Array:
        """(..., 3, 3) blocks of covariances (..., 6, 6)."""
        rows = list(self.axes)
        return np.asarray(np.asarray(covariances, dtype=np.float64)[..., rows, :][..., rows])

    def poses(self, states: Array) -> Array:
        """(..., 7) poses at coordinates (..., 3): at height 0, or not turned."""
        if self.has_yaw:
            return pose_vector_from_planar(states)
        still = np.broadcast_to([0.0, 0.0, 0.0, 1.0], (*states.shape[:-1], 4))
        return np.concatenate([states, still], axis=-1)

    def pose_covariances(self, covariances: Array) -> Array:
        """(..., 6, 6) covariances of poses, 0 along and about the other axes, from (..., 3, 3)."""
        whole = np.zeros((*covariances.shape[:-2], 6, 6))
        rows = np.array(self.axes)
        whole[..., rows[:, None], rows] = covariances
        return whole

    def difference(self, states: Array, others: Array) -> Array:
        """(..., 3) from ``others`` to ``states``, a heading's in [-pi, pi)."""
        off = states - others
        if self.has_yaw:
            off[..., 2] = wrap_angle(off[..., 2])
        return np.asarray(off)


IN_THE_PLANE = ObjectCoordinates(PLANAR_AXES, has_yaw=True)
IN_SPACE = ObjectCoordinates((0, 1, 2), has_yaw=False)


def object_coordinates(state_space: str) -> ObjectCoordinates:
    """The coordinates of objects in maps of a state space, planar or spatial."""
    return IN_SPACE if state_space == "spatial" else IN_THE_PLANE
