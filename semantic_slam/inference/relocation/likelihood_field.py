"""Likelihood field for localisation on a map: a vote of recent detections over a grid of poses.

A detection is likely about each map object; its log density at a point is looked up in a precomputed field, so that a
pose costs one look-up per detection. This only proposes: the replay of a proposed history determines its weight.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import wrap_angle

CELL_M, TURN_RAD = 0.2, 0.1
"""Grid spacing of poses [m, rad]."""
BLUR_M = 0.35
"""Standard deviation of a detection about its object, including that of the grid and of odometry since."""
ELSEWHERE = 0.05
"""Density per square metre of detections of unmapped objects."""
ONE_M = 0.5
"""Distance within which detections are taken to be of one object."""
APART_M, APART_RAD = 0.8, 0.3
"""Least difference between two proposals, in position or heading."""


@dataclass(frozen=True, kw_only=True)
class LikelihoodField:
    """The log density of detections about the objects of a map, on a grid."""

    corner: Array  # (2,) of the grid of positions
    counts: tuple[int, int]  # of the grid's cells
    margin: int  # cells around it within reach of detections
    log_density: Array  # (N, X + 2 margin, Y + 2 margin) of each detection

    @classmethod
    def of(
        cls, centre: Array, half_m: float, reach_m: float, points: Array, sigmas: Array, log_alike: Array
    ) -> "LikelihoodField":
        """The field for positions in a square about ``centre``, and detections up to ``reach_m`` beyond.

        ``points`` (M, 2) of objects with standard deviations (M,); ``log_alike`` (N, M) nats: class similarity of N
        detections.
        """
        count, margin = 1 + 2 * round(half_m / CELL_M), int(np.ceil(reach_m / CELL_M)) + 1
        corner = centre - CELL_M * (count // 2)
        axis = CELL_M * (np.arange(count + 2 * margin) - margin)
        x, y = corner[0] + axis, corner[1] + axis
        variances = (sigmas**2 + BLUR_M**2)[:, None]
        along_x, along_y = (
            np.exp(-0.5 * (values - at[:, None]) ** 2 / variances) for values, at in zip((x, y), points.T, strict=True)
        )
        about = along_x[:, :, None] * along_y[:, None] / (2.0 * np.pi * variances[..., None])  # (M, X, Y)
        density = 1.0 + np.tensordot(np.exp(log_alike) / ELSEWHERE, about, axes=1)
        return cls(corner=corner, counts=(count, count), margin=margin, log_density=np.log(density))

    def likeliest(self, seen: Array, log_prior: Callable[[Array], Array], most: int) -> Array:
        """(P, 3) distinct poses at which points (N, 2) in the robot's frame fit best, the best first."""
        turns = np.arange(-np.pi, np.pi, TURN_RAD)
        scores = np.array([self._scores(seen, float(turn)) for turn in turns])
        poses = self._poses(turns)
        scores += log_prior(poses)
        found = list[Array]()
        for at in np.argsort(-scores, axis=None, kind="stable"):
            pose = poses.reshape(-1, 3)[at]
            if all(differ(pose, other) for other in found):
                found.append(pose)
            if len(found) == most:
                break
        return np.array(found)

    def _scores(self, seen: Array, turn: float) -> Array:
        """(X, Y) log density of all points seen from each position, relative to unmapped objects."""
        cosine, sine = np.cos(turn), np.sin(turn)
        at = np.round(seen @ np.array([[cosine, sine], [-sine, cosine]]) / CELL_M).astype(int) + self.margin
        total, shares = np.zeros(self.counts), _shares(seen)
        for share, own, (x, y) in zip(shares, self.log_density, np.clip(at, 0, 2 * self.margin), strict=True):
            total += share * own[x : x + self.counts[0], y : y + self.counts[1]]
        return total

    def _poses(self, turns: Array) -> Array:
        """(T, X, Y, 3) poses of the grid."""
        x, y = (self.corner[axis] + CELL_M * np.arange(self.counts[axis]) for axis in (0, 1))
        return np.stack(np.meshgrid(turns, x, y, indexing="ij"), axis=-1)[..., [1, 2, 0]]


def differ(one: Array, other: Array) -> bool:
    """Whether two poses (3,) are distinct proposals."""
    return bool(np.hypot(*(one - other)[:2]) > APART_M or abs(wrap_angle(one[2] - other[2])) > APART_RAD)


def _shares(seen: Array) -> Array:
    """(N,) weights of detections: several of one object say little more than one does."""
    away = np.linalg.norm(seen[:, None] - seen, axis=-1)
    return np.asarray((away < ONE_M).sum(axis=1) ** -0.5)
