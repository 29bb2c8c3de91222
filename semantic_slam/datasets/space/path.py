"""Poses in all six of a body that moves in space."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry import se3, so3
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.transform import interpolate

LEAST_STEP_NS = 30_000_000
"""Odometry that is made of true poses is not told more often: motion capture trembles from sample to sample."""


@dataclass(frozen=True)
class SpatialPath:
    """N poses in one frame, at stamps that grow."""

    stamps_ns: NDArray[np.int64]  # (N,)
    poses: Array  # (N, 7) x y z [m] qx qy qz qw
    covariances: Array | None = None  # (N, 6, 6) x y z rx ry rz along the axes of the frame; None: not known

    def moved(self, T_to_from: Array) -> "SpatialPath":
        """The path without its covariances in the frame in which the present one has the pose (7,)."""
        return SpatialPath(self.stamps_ns, se3.compose(T_to_from, self.poses))

    def since(self, stamp_ns: int) -> "SpatialPath":
        """The path from an instant on, at which it has a pose; the whole one where it begins later."""
        if stamp_ns <= self.stamps_ns[0]:
            return self
        later = int(np.searchsorted(self.stamps_ns, stamp_ns))
        if later == len(self.stamps_ns):
            return SpatialPath(self.stamps_ns[-1:], self.poses[-1:])
        before, after = self.stamps_ns[later - 1 : later + 1]
        first = interpolate(self.poses[later - 1], self.poses[later], float((stamp_ns - before) / (after - before)))
        rest = slice(later + int(after == stamp_ns), None)
        stamps = np.concatenate([[stamp_ns], self.stamps_ns[rest]])
        return SpatialPath(stamps, np.concatenate([first[None], self.poses[rest]]))

    def thinned(self) -> "SpatialPath":
        """The path with no two poses nearer in time than :data:`LEAST_STEP_NS`."""
        kept = [0]
        for row, stamp_ns in enumerate(self.stamps_ns.tolist()):
            if stamp_ns - self.stamps_ns[kept[-1]] >= LEAST_STEP_NS:
                kept.append(row)
        return SpatialPath(self.stamps_ns[kept], self.poses[kept])


def of_camera(stamps_ns: NDArray[np.int64], T_world_camera: Array, T_body_camera: Array) -> SpatialPath:
    """The path of a body that has a camera, from (N, 4, 4) poses of its optical frame."""
    camera = np.concatenate([T_world_camera[:, :3, 3], so3.from_matrix(T_world_camera[:, :3, :3])], axis=1)
    return SpatialPath(stamps_ns, se3.wrapped(se3.compose(camera, se3.inverse(T_body_camera))))
