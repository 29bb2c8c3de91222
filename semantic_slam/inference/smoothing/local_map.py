"""Local map: joint covariance of the robot and nearby objects, propagated from keyframe to keyframe as in an EKF.

Marginals of old objects lie deep in the Bayes tree of a long drive and would cost more than everything else. Once the
joint Gaussian of robot and neighbourhood is known, odometry and detections update it in closed form. It is read from
the smoother again when another object comes near, when the estimate jumps, and after a while.

Where estimates change, position errors are taken without the part that the robot's heading error causes (an invariant
error). A filter that relinearises at ever new estimates otherwise gains spurious information on the heading of the
whole map, which nothing measures (Barrau and Bonnabel, An EKF-SLAM algorithm with consistency properties, 2015).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.inference.models.spatial.gravity import Gravity
from semantic_slam.inference.states.layout import Layout

LARGEST_AGE = 25
"""Keyframes after which the covariance is read from the smoother again."""


@dataclass(frozen=True)
class LocalDetection:
    """One detection of a known object: whitened Jacobians (m, r), (m, l) and (m, q) at the prediction."""

    object_id: int
    by_robot: Array
    by_object: Array
    by_errors: Array  # by the frame's correlated errors


@dataclass(frozen=True)
class LocalStart:
    """A new object at ``state`` (s,), linear in robot and correlated errors: o = G x + H f + e."""

    object_id: int
    state: Array
    gain: Array  # G (l, r)
    noise: Array  # (l, l) covariance of e
    by_errors: Array  # H (l, q)


@dataclass(frozen=True, kw_only=True)
class LocalMap:
    """M objects about the robot, which have r and l tangent dimensions.

    Also p biases of odometry, and q correlated errors of the newest frame's detections.
    """

    layout: Layout
    ids: Index  # (M,)
    robot: Array  # (s,) estimate in whose tangent space the covariance is
    objects: Array  # (M, s) estimates
    covariance: Array  # (r + p + q + M l) square: robot, biases, errors, objects, in tangent spaces at the estimates
    age: int = 0
    num_biases: int = 0  # p
    num_errors: int = 0  # q

    @property
    def propagated(self) -> slice:
        """Rows of robot, biases and correlated errors."""
        return slice(0, self.layout.robot + self.num_biases + self.num_errors)

    @property
    def errors(self) -> slice:
        """Rows of the correlated errors."""
        return slice(self.layout.robot + self.num_biases, self.propagated.stop)

    def holds(self, object_ids: Index) -> bool:
        """Whether all of (n,) objects are in this map."""
        return set(object_ids.tolist()) <= set(self.ids.tolist())

    def rows(self, object_ids: Index) -> Index:
        """Rows of the covariance for the robot and (n,) objects."""
        place = {n: row for row, n in enumerate(self.ids.tolist())}
        rows = self.layout.rows([0, *(1 + place[n] for n in object_ids.tolist())])
        rows[self.layout.robot :] += self.num_biases + self.num_errors
        return rows

    def of(self, object_ids: Index) -> Array:
        """(r + n l, r + n l) joint covariance of the robot and (n,) objects."""
        rows = self.rows(object_ids)
        return self.covariance[rows[:, None], rows]

    def single(self, object_ids: Index) -> Array:
        """(n, l, l) marginal covariances of (n,) objects."""
        rows = self.rows(object_ids)[self.layout.robot :].reshape(-1, self.layout.landmark)
        return self.covariance[rows[:, :, None], rows[:, None, :]]

    def moved(self, robot: Array, before: Array, transition: Array, noise: Array) -> "LocalMap":
        """The map after a motion to ``robot`` (s,), with its (r, r + p) transition [F G] and process ``noise``.

        ``before``: covariance before the motion, in the layout of this map.
        """
        size, width = transition.shape
        covariance = before.copy()
        covariance[:size] = transition @ covariance[:width]
        covariance[:, :size] = covariance[:, :width] @ transition.T
        covariance[:size, :size] += noise
        return replace(self, robot=robot, covariance=covariance, age=self.age + 1)

    def levelled(self, gravity: Gravity | None, robot: Array) -> tuple["LocalMap", Array | None]:
        """The map after a measurement of gravity at predicted robot (s,), and the resulting shift of all means."""
        if gravity is None:
            return self, None
        level = gravity.levels(robot, self.covariance)
        return replace(self, covariance=level.covariance), level.shift

    def at(self, robot: Array, objects: Array) -> "LocalMap":
        """The map relinearised at other estimates (s,) and (M, s), with the heading error's effect about the new ones.

        Poses are x, y, yaw with tangents in their own frames; positions are x, y.
        """
        heading = 2
        before, after = self.objects, objects
        places = np.concatenate([[0], self._starts()])
        positions = places[:, None] + np.arange(2)
        shift = np.concatenate([(robot - self.robot)[None, :2], (after - before)[:, :2]])
        turns = np.concatenate([[robot[2] - self.robot[2]], np.zeros(len(after))])
        frames = np.concatenate([[robot[2]], np.zeros(len(after))])
        if self.layout.landmark > heading:
            turns[1:], frames[1:] = after[:, 2] - before[:, 2], after[:, 2]
        turned_back = _rotations(-turns)  # from the old tangent space to the new one
        aside = _rotations(-frames) @ np.stack([-shift[:, 1], shift[:, 0]], axis=1)[..., None]  # (1 + M, 2, 1)
        covariance = self.covariance.copy()
        for _ in range(2):  # rows, and then columns
            blocks = turned_back @ covariance[positions] + aside * covariance[heading]
            covariance[positions] = blocks
            covariance = np.ascontiguousarray(covariance.T)
        return replace(self, robot=robot, objects=objects, covariance=covariance)

    def at_estimates(self, ids: Index, robot: Array, objects: Array) -> "LocalMap":
        """The map of those objects that are among ``ids`` (O,), ascending, at all estimates (s,) and (O, s)."""
        rows = np.searchsorted(ids, self.ids)
        kept = np.append(ids, -1)[rows] == self.ids
        left = self if kept.all() else self.without(~kept)
        return left.at(robot, objects[rows[kept]])

    def without(self, gone: Flags) -> "LocalMap":
        """The map of the objects that are not ``gone`` (M,)."""
        rows = np.concatenate([np.zeros(self.propagated.stop, dtype=bool), np.repeat(gone, self.layout.landmark)])
        covariance = self.covariance[~rows][:, ~rows]
        return replace(self, ids=self.ids[~gone], objects=self.objects[~gone], covariance=covariance)

    def _starts(self) -> Index:
        """(M,) first row of each object."""
        return np.asarray(self.propagated.stop + self.layout.landmark * np.arange(len(self.ids)))

    def with_errors(self, matrix: Array, noise: Array) -> "LocalMap":
        """The map with correlated errors f' = A f + v, ``matrix`` A and ``noise`` the covariance of v."""
        before, split, end = self.covariance, self.errors.start, self.errors.stop
        rows, size = slice(split, split + len(matrix)), len(before) + len(matrix) - self.num_errors
        parts = (slice(split), slice(split)), (slice(end, None), slice(rows.stop, None))
        cross, covariance = matrix @ before[self.errors], np.empty((size, size))
        for old, new in parts:
            covariance[new, :split], covariance[new, rows.stop :] = before[old, :split], before[old, end:]
            covariance[rows, new], covariance[new, rows] = cross[:, old], cross[:, old].T
        covariance[rows, rows] = matrix @ before[self.errors, self.errors] @ matrix.T + noise
        return replace(self, covariance=covariance, num_errors=len(matrix))

    def updated(self, detections: list[LocalDetection]) -> "LocalMap":
        """The map after detections of objects in it (a Kalman update of the covariance)."""
        if not detections:
            return self
        by_robot = np.array([item.by_robot for item in detections])  # (n, m, r)
        (count, size), width = by_robot.shape[:2], len(self.covariance)
        each, components = np.arange(count)[:, None, None], np.arange(size)[:, None]
        landmarks = self.rows(np.array([item.object_id for item in detections]))[self.layout.robot :]
        slopes = np.zeros((count, size, width))
        slopes[..., : self.layout.robot] = by_robot
        slopes[..., self.errors] = [item.by_errors for item in detections]
        slopes[each, components, landmarks.reshape(count, 1, -1)] = [item.by_object for item in detections]
        jacobian = slopes.reshape(-1, width)
        cross = jacobian @ self.covariance
        innovation = cross @ jacobian.T + np.eye(count * size)
        return replace(self, covariance=self.covariance - cross.T @ np.linalg.solve(innovation, cross))

    def with_new(self, started: Sequence[LocalStart]) -> "LocalMap":
        """The map with new objects, which are linear in robot and correlated errors."""
        if not started:
            return self
        slopes = np.zeros((self.layout.landmark * len(started), len(self.covariance)))
        slopes[:, : self.layout.robot] = np.concatenate([own.gain for own in started])
        slopes[:, self.errors] = np.concatenate([own.by_errors for own in started])
        cross = slopes @ self.covariance
        new = cross @ slopes.T
        for place, own in enumerate(started):
            rows = slice(self.layout.landmark * place, self.layout.landmark * (place + 1))
            new[rows, rows] += own.noise
        covariance = np.block([[self.covariance, cross.T], [cross, new]])
        ids = np.append(self.ids, [own.object_id for own in started])
        objects = np.concatenate([self.objects, [own.state for own in started]])
        return replace(self, ids=ids, objects=objects, covariance=covariance)


def _rotations(angles: Array) -> Array:
    """(n, 2, 2) rotation matrices of (n,) angles [rad]."""
    cos, sin = np.cos(angles), np.sin(angles)
    return np.stack([np.stack([cos, -sin], axis=-1), np.stack([sin, cos], axis=-1)], axis=-2)
