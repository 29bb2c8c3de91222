"""Trajectories: interpolation, dead reckoning, rigid alignment, absolute and relative trajectory errors."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array


@dataclass(frozen=True)
class Trajectory:
    """N poses in stamp order."""

    stamps_ns: NDArray[np.int64]  # (N,) strictly increasing
    poses: Array  # (N, 7) x y z qx qy qz qw

    def __len__(self) -> int:
        return len(self.stamps_ns)


def interpolate(trajectory: Trajectory, stamps_ns: NDArray[np.int64]) -> Array:
    """(M, 7) poses at ``stamps_ns``: linear positions, slerp of rotations; NaN outside the trajectory's time."""
    poses = np.full((len(stamps_ns), 7), np.nan)
    if len(trajectory) == 0:
        return poses
    inside = (stamps_ns >= trajectory.stamps_ns[0]) & (stamps_ns <= trajectory.stamps_ns[-1])
    if len(trajectory) == 1:
        poses[inside] = trajectory.poses[0]
        return poses
    seconds = (trajectory.stamps_ns - trajectory.stamps_ns[0]) * 1e-9
    wanted = (np.asarray(stamps_ns)[inside] - trajectory.stamps_ns[0]) * 1e-9
    for axis in range(3):
        poses[inside, axis] = np.interp(wanted, seconds, trajectory.poses[:, axis])
    if inside.any():
        poses[inside, 3:] = Slerp(seconds, Rotation.from_quat(trajectory.poses[:, 3:]))(wanted).as_quat()
    return poses


def dead_reckoning(start: Array, odometry: Array) -> Array:
    """(N, 7) poses in map of a robot that starts at ``start`` (7,) and trusts its (N, 7) odometry.

    T_map_body(n) = T_map_body(0) * T_odom_body(0)^-1 * T_odom_body(n).
    """
    rotation, first = Rotation.from_quat(odometry[:, 3:]), Rotation.from_quat(odometry[0, 3:])
    turn = Rotation.from_quat(start[3:]) * first.inv()
    positions = start[:3] + turn.apply(odometry[:, :3] - odometry[0, :3])
    return np.hstack([positions, (turn * rotation).as_quat()])


def absolute_trajectory_error(estimate: Array, reference: Array) -> float:
    """Root mean square distance [m] of (N, 2 or 3) positions, rows with NaN left out; NaN when none is left."""
    squared = np.sum((estimate - reference) ** 2, axis=1)
    squared = squared[np.isfinite(squared)]
    return float(np.sqrt(squared.mean())) if len(squared) else float("nan")


@dataclass(frozen=True)
class RigidMotion:
    """p -> rotation p + translation in the plane or in space, d = 2 or 3."""

    rotation: Array  # (d, d)
    translation: Array  # (d,)

    def applied(self, points: Array) -> Array:
        """(N, d) points, moved."""
        return np.asarray(points @ self.rotation.T + self.translation)


def alignment(estimate: Array, reference: Array) -> RigidMotion:
    """Rotation and translation (no scale) that bring ``estimate`` closest to ``reference``; both (N, 2 or 3).

    The least squares solution of Umeyama 1991 by a singular value decomposition; rows with NaN do not vote, and
    without any other row nothing is moved.
    """
    size = estimate.shape[1]
    rows = np.isfinite(estimate).all(axis=1) & np.isfinite(reference).all(axis=1)
    if not rows.any():
        return RigidMotion(np.eye(size), np.zeros(size))
    mean_estimate, mean_reference = estimate[rows].mean(axis=0), reference[rows].mean(axis=0)
    covariance = (reference[rows] - mean_reference).T @ (estimate[rows] - mean_estimate)
    left, _, right = np.linalg.svd(covariance)
    signs = np.ones(size)
    signs[-1] = np.sign(np.linalg.det(left @ right))
    rotation = left * signs @ right
    return RigidMotion(rotation, mean_reference - rotation @ mean_estimate)


def align(estimate: Array, reference: Array) -> Array:
    """``estimate`` moved by its :func:`alignment` with ``reference``; both (N, 2 or 3)."""
    return alignment(estimate, reference).applied(estimate)


def relative_error_per_metre(estimate: Array, reference: Array, length_m: float = 1.0) -> float:
    """Mean error of the robot's motion over stretches of ``length_m``, metres per metre; planar poses (N, 3).

    A stretch runs from every pose to the first one that lies ``length_m`` of the reference's path ahead, and its error
    is the distance between where both motions end, divided by the length of the stretch (Geiger et al. 2012). NaN
    where no stretch is that long; poses with NaN are left out.
    """
    rows = np.isfinite(estimate).all(axis=1) & np.isfinite(reference).all(axis=1)
    estimate, reference = estimate[rows], reference[rows]
    steps = np.linalg.norm(np.diff(reference[:, :2], axis=0), axis=1)
    travelled = np.concatenate([[0.0], np.cumsum(steps)])
    ends = np.searchsorted(travelled, travelled + length_m)
    starts = np.flatnonzero(ends < len(reference))
    if not len(starts):
        return float("nan")
    ends = ends[starts]
    moved, true = (se2.between(path[starts], path[ends]) for path in (estimate, reference))
    errors = np.linalg.norm(se2.between(true, moved)[:, :2], axis=1)
    return float((errors / (travelled[ends] - travelled[starts])).mean())
