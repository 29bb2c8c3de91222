"""The objects of one hypothesis in an open world: how surely each exists, and where it was after the last update."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array, Index


@dataclass(frozen=True)
class ObjectTable:
    """O objects, ascending by id; r and l dimensions of the tangent spaces, T keyframes so far."""

    ids: Index  # (O,)
    existence: Array  # (O,)
    states: Array  # (O, s) after the newest update
    covariances: Array  # (O, l, l) when the object was last near: later updates only narrow it
    sigmas: Array  # (O,) largest standard deviation of a position then, metres
    robot: Array  # (s,) after the newest update
    robot_covariance: Array  # (r, r)
    trail: Array  # (T, s) robot at each keyframe, as estimated then
    bias: Array = field(default_factory=lambda: np.zeros(0))  # (p,) of odometry, after the newest update
    bias_covariance: Array | None = None  # (r + p, r + p) of robot and bias; None: p is 0

    @property
    def motion_covariance(self) -> Array:
        """(r + p, r + p) of the newest robot and what odometry always gets wrong."""
        return self.robot_covariance if self.bias_covariance is None else self.bias_covariance

    def rows(self, object_ids: Index) -> Index:
        """Where (n,) objects stand; all of them must be there."""
        return np.asarray(np.searchsorted(self.ids, object_ids))


@dataclass(frozen=True)
class ExistenceUpdate:
    """What one continuation makes of its parent's O objects, and of those that it starts."""

    existence: Array  # (O,) after this keyframe
    kept: NDArray[np.bool_]  # (O,)
    new_ids: Index  # (n,) ascending, above all of the parent's
    new_existence: Array  # (n,)
