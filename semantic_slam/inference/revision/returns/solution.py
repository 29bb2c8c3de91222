"""Maximum a posteriori solution of a whole drive under one history, and its evidence.

Gauss-Newton to the optimum, and the Laplace approximation there.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import csr_array

from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.inference.models.odometry_bias import CHANGE
from semantic_slam.inference.revision.returns.whole_drive import WholeDrive

MAX_STEPS = 12
"""Most Gauss-Newton steps."""
CONVERGED = 0.05
"""Gain of a step [nats] below which it is the last one."""
HALVINGS = 6
"""Most halvings of a step that increases the error."""


@dataclass(frozen=True, kw_only=True)
class Solution:
    """The robot's path and N objects of a history, those of a map first, and the geometric evidence."""

    path: Array  # (1 + T, 3) from the pose before the first keyframe on
    biases: Array  # (S, p)
    places: Array  # (N, 2)
    covariance: Array  # (2 N, 2 N) of the places
    log_evidence: float  # with one object per square metre; up to a constant of the drive


def solved(drive: WholeDrive, objects: Index, path: Array, biases: Array | None = None) -> Solution:
    """The optimum next to ``path`` (1 + T, 3) where the n detections are of ``objects``, 0 to N - 1.

    Raises numpy.linalg.LinAlgError where the system is indeterminate.
    """
    count = max(int(objects.max(initial=-1)) + 1, len(drive.map_places))
    first = np.zeros(drive.num_biases) if biases is None else biases
    now = System(drive, objects, path, first, _first_places(drive, objects, count, path))
    for _ in range(MAX_STEPS):
        factor = cho_factor(now.matrix, lower=True, overwrite_a=True, check_finite=False)
        step = -cho_solve(factor, now.slope, check_finite=False)
        after = now.moved(step)
        for _ in range(HALVINGS):
            if after.error <= now.error:
                break
            step = 0.5 * step
            after = now.moved(step)
        gain, now = now.error - after.error, after
        if gain < CONVERGED:
            break
    last = np.arange(len(step) - 2 * count, len(step))
    columns = np.zeros((len(step), 2 * count))
    columns[last, np.arange(2 * count)] = 1.0
    log_determinant = 2.0 * float(np.log(np.diagonal(factor[0])).sum())
    return Solution(
        path=now.path,
        biases=now.biases,
        places=now.places,
        covariance=cho_solve(factor, columns, check_finite=False)[last],
        log_evidence=-now.error - 0.5 * log_determinant + count * float(np.log(2.0 * np.pi)),
    )


def _first_places(drive: WholeDrive, objects: Index, count: int, path: Array) -> Array:
    """(N, 2) initial positions: means of the detections seen from a path; those of the map as mapped."""
    places, times = np.zeros((count, 2)), np.bincount(objects, minlength=count)
    np.add.at(places, objects, drive.seen_from(path))
    places /= np.maximum(times, 1)[:, None]
    places[: len(drive.map_places)] = drive.map_places
    return places


@dataclass(frozen=True)
class System:
    """The normal equations at one point; columns are poses, biases and positions."""

    drive: WholeDrive
    objects: Index  # (n,)
    path: Array  # (1 + T, 3)
    biases: Array  # (S, p)
    places: Array  # (N, 2)

    def moved(self, step: Array) -> "System":
        """The point after a step in all columns."""
        poses, biases, places = np.split(step, [self.path.size, self.path.size + self.biases.size])
        return System(
            self.drive,
            self.objects,
            se2.retract(self.path, poses.reshape(-1, 3)),
            self.biases + biases.reshape(self.biases.shape),
            self.places + places.reshape(-1, 2),
        )

    @cached_property
    def error(self) -> float:
        """Half the sum of squared whitened residuals."""
        polar = self._polar.ravel()
        return 0.5 * float(self._plain @ self._plain + polar @ self.drive.information @ polar)

    @property
    def matrix(self) -> Array:
        """(m, m) information matrix (Gauss-Newton Hessian)."""
        plain, polar = self._slopes
        return np.asarray((plain.T @ plain).toarray() + polar.T @ (self.drive.information @ polar))

    @property
    def slope(self) -> Array:
        """(m,) gradient of the error."""
        plain, polar = self._slopes
        return np.asarray(plain.T @ self._plain + polar.T @ (self.drive.information @ self._polar.ravel()))

    @cached_property
    def _begin_whiten(self) -> Array:
        return np.linalg.inv(np.linalg.cholesky(self.drive.begin.covariance))

    @cached_property
    def _plain(self) -> Array:
        """Independent residuals: those of the start pose, motions, biases and map positions."""
        drive = self.drive
        begin = self._begin_whiten @ se2.log(se2.between(drive.begin.mean, self.path[0]))
        offset = se2.log(se2.between(drive.controls, se2.between(self.path[:-1], self.path[1:])))
        offset = offset - (drive.by_bias @ self.biases[drive.stretches][..., None])[..., 0]
        motions = (drive.whiten @ offset[..., None])[..., 0]
        changes = np.diff(self.biases, axis=0) / CHANGE
        away = self.places[: len(drive.map_places)] - drive.map_places
        mapped = (drive.map_whiten @ away[..., None])[..., 0]
        return np.concatenate([part.ravel() for part in (begin, motions, self.biases[:1], changes, mapped)])

    @cached_property
    def _relative(self) -> Array:
        """(n, 2) object positions in the frames of the robots that detect them."""
        robots = self.path[1 + self.drive.keyframes]
        away, cos, sin = self.places[self.objects] - robots[:, :2], np.cos(robots[:, 2]), np.sin(robots[:, 2])
        return np.stack([cos * away[:, 0] + sin * away[:, 1], cos * away[:, 1] - sin * away[:, 0]], axis=1)

    @cached_property
    def _polar(self) -> Array:
        """(n, 2) residuals of range and bearing."""
        x, y = self._relative.T
        residual = np.stack([np.hypot(x, y), np.arctan2(y, x)], axis=1) - self.drive.polar
        residual[:, 1] = wrap_angle(residual[:, 1])
        return np.asarray((self.drive.polar_whiten @ residual[..., None])[..., 0])

    @cached_property
    def _slopes(self) -> tuple[csr_array, csr_array]:
        """Jacobians of the independent residuals, and of ranges and bearings."""
        drive, poses = self.drive, self.path.size
        size = poses + self.biases.size + self.places.size
        begin, sizes = [(0, 0, self._begin_whiten[None])], self.biases.shape
        relative = se2.between(self.path[1:], self.path[:-1])
        steps, at = np.arange(len(drive.controls)), 3
        parts = [(at + 3 * steps, 3 * steps, -drive.whiten @ se2.adjoint(relative))]
        parts += [(at + 3 * steps, 3 * steps + 3, drive.whiten)]
        parts += [(at + 3 * steps, poses + sizes[1] * drive.stretches, -drive.whiten @ drive.by_bias)]
        at += 3 * len(steps)
        parts += [(np.array([at]), np.array([poses]), np.eye(sizes[1])[None])]
        at, later = at + sizes[1], np.arange(sizes[0] - 1)
        for offset, sign in ((0, -1.0), (1, 1.0)):
            block = np.broadcast_to(sign / CHANGE * np.eye(sizes[1]), (len(later), sizes[1], sizes[1]))
            parts += [(at + sizes[1] * later, poses + sizes[1] * (later + offset), block)]
        at, known = at + sizes[1] * len(later), np.arange(len(drive.map_places))
        parts += [(at + 2 * known, poses + self.biases.size + 2 * known, drive.map_whiten)]
        parts += [(np.zeros(1, dtype=int), np.zeros(1, dtype=int), begin[0][2])]
        return _sparse(parts, len(self._plain), size), self._polar_slopes(size)

    def _polar_slopes(self, size: int) -> csr_array:
        drive, (x, y) = self.drive, self._relative.T
        squared = np.maximum(x**2 + y**2, 1e-6)
        reach = np.sqrt(squared)
        by_place = drive.polar_whiten @ np.stack(
            [np.stack([x / reach, y / reach], axis=1), np.stack([-y / squared, x / squared], axis=1)], axis=1
        )  # (n, 2, 2) in the robot's frame
        by_robot = by_place @ np.stack(
            [np.stack([-np.ones_like(x), 0 * x, y], axis=1), np.stack([0 * x, -np.ones_like(x), -x], axis=1)], axis=1
        )
        turn = self.path[1 + drive.keyframes, 2]
        back = np.stack(
            [np.stack([np.cos(turn), np.sin(turn)], axis=1), np.stack([-np.sin(turn), np.cos(turn)], axis=1)], axis=1
        )
        rows, first = 2 * np.arange(len(self.objects)), self.path.size + self.biases.size
        parts = [(rows, 3 + 3 * drive.keyframes, by_robot), (rows, first + 2 * self.objects, by_place @ back)]
        return _sparse(parts, 2 * len(self.objects), size)


def _sparse(parts: list[tuple[Index, Index, Array]], rows: int, columns: int) -> csr_array:
    """A sparse matrix of blocks (n, a, b), each placed at its row and column."""
    values, at_rows, at_columns = [], [], []
    for first_rows, first_columns, blocks in parts:
        row = first_rows[:, None, None] + np.arange(blocks.shape[1])[:, None]
        column = first_columns[:, None, None] + np.arange(blocks.shape[2])
        shape = len(blocks), *blocks.shape[1:]
        at_rows.append(np.broadcast_to(row, shape).ravel())
        at_columns.append(np.broadcast_to(column, shape).ravel())
        values.append(np.broadcast_to(blocks, shape).ravel())
    where = np.concatenate(at_rows), np.concatenate(at_columns)
    return csr_array((np.concatenate(values), where), shape=(rows, columns))
