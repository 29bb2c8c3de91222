"""Batched problems over windows: robot states and objects since the keyframe at which a hypothesis was last Gaussian.

Measurements of gravity since then are among the likelihoods of a window.
The states are x_a = mean Exp(L y_a), o = mean Exp(L y_o) and x_t = x_(t-1) u_t Exp(M_t y_t), so that y ~ N(0, I)
exactly and the evidence of everything since is the mean of the likelihood over y: Eq. 4.18 for the whole window.
Hypotheses of the same shape (same keyframes since the anchor, same number of objects) form one batch.
"""

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from semantic_slam.geometry.arrays import Array, Index, broadcast_copy, row_sums, squared_norms
from semantic_slam.inference.models.observation import Linearisation, ObservationModel
from semantic_slam.inference.models.step import Motion
from semantic_slam.inference.states.spaces import Spaces


@dataclass(frozen=True)
class WindowKeyframe:
    """The motion and detections that one keyframe adds to every window problem of a batch."""

    motion: Motion
    detections: tuple[Any, ...]


@dataclass(frozen=True, kw_only=True)
class AnchorPrior:
    """K Gaussians over robot and O objects at the anchor, and the associations of the S detections since."""

    mean: Array  # (K, 1 + O, s), the robot's first
    covariance: Array  # (K, r + O l, r + O l)
    places: Index  # (K, S) among the objects
    classes: Index  # (K, S), -1: no semantics, or an outlier where classes are enumerated


class WindowProblem:
    """The energy -log p(Z | y) + |y|^2 / 2 of T keyframes after the anchor, for K hypotheses.

    The blocks of y: robot and objects at the anchor, then the T motions of the robot; ``size`` = r + O l + T r numbers.
    Of K N rows of y the first N are of the first hypothesis, and so on.
    """

    def __init__(self, spaces: Spaces, model: ObservationModel, anchored: AnchorPrior, links: Sequence[WindowKeyframe]):
        self.spaces, self.layout, self.model, self.links = spaces, spaces.layout, model, tuple(links)
        self._count = anchored.mean.shape[1]
        self._joint = spaces.joint_with_motions(self._count - 1)
        self.places, self.classes = anchored.places, anchored.classes
        self.root = np.asarray(np.linalg.cholesky(anchored.covariance), dtype=np.float64)
        self.width = self.root.shape[-1]
        controls = np.array([link.motion.control for link in links]).reshape(len(links), spaces.storage.robot)
        every = np.tile(controls, (len(anchored.mean), 1, 1))
        self._frames = self._joint.frame(spaces.storage.stacked(anchored.mean, every))  # (K, 1 + O + T, f)
        self.motion_roots = [np.linalg.cholesky(link.motion.covariance) for link in links]
        self.size = self.motion_rows(len(links)).start
        self._times = np.array([t + 1 for t, link in enumerate(links) for _ in link.detections], dtype=int)
        self._levels = [(t + 1, link.motion.gravity) for t, link in enumerate(links) if link.motion.gravity is not None]
        collected = model.collect([detection for link in links for detection in link.detections])
        named = np.full(len(self._times), model.num_classes > 0)
        self._parts = [  # detections with and without semantics
            (
                collected if rows.all() else collected.take(np.flatnonzero(rows)),
                np.flatnonzero(rows),
                bool(rows is named),
            )
            for rows in (named, ~named)
            if rows.any()
        ]

    def __len__(self) -> int:
        return len(self.root)

    def motion_rows(self, number: int) -> slice:
        """Coordinates of one motion in y."""
        start = self.width + number * self.layout.robot
        return slice(start, start + self.layout.robot)

    @property
    def mean(self) -> Array:
        """(K, 1 + O, s) of robot and objects at the anchor."""
        return self._frames[:, : self._count, : self.spaces.storage.width]

    def select(self, selection: Any) -> "WindowProblem":
        """The problem of the chosen hypotheses, each any number of times."""
        part = copy.copy(self)
        part.root, part._frames = self.root[selection], self._frames[selection]
        part.places, part.classes = self.places[selection], self.classes[selection]
        return part

    def coordinates(self, robots: Array, objects: Array) -> Array:
        """(K, size) y of robot states (K, 1 + T, s), the anchor's first, and objects (K, O, s)."""
        robot = self.spaces.robot
        anchor = self.spaces.joint.local(self.mean, self.spaces.storage.stacked(robots[:, :1], objects))
        blocks = [np.linalg.solve(self.root, self.layout.joined(anchor)[..., None])[..., 0]]
        for t, (link, root) in enumerate(zip(self.links, self.motion_roots, strict=True)):
            moved = robot.compose(robots[:, t], link.motion.control)
            blocks.append(np.linalg.solve(root, robot.local(moved, robots[:, t + 1])[..., None])[..., 0])
        return np.concatenate(blocks, axis=1)

    def newest_slopes(self, y: Array) -> Array:
        """(K, 1 + O, w, size) derivatives of the newest robot state and of the objects by y (K, size)."""
        moves, chart = self._joint.exp_and_jacobian(self._tangents(y))
        by_robot, by_object = self._slopes(self._composed(moves), chart)
        slopes = np.zeros((len(y), self._count, self.layout.width, self.size))
        slopes[:, 0, : self.layout.robot] = by_robot[:, 0, -1]
        slopes[:, 1:, : self.layout.landmark, : self.width] = by_object[:, 0]
        return slopes

    def states(self, y: Array) -> tuple[Array, Array]:
        """(B, 1 + T, s) robot, the anchor's first, and (B, O, s) objects."""
        robots, objects = self._states(y)
        robots, objects = self.spaces.robot.wrapped(robots), self.spaces.landmark.wrapped(objects)
        return robots.reshape(len(y), *robots.shape[2:]), objects.reshape(len(y), *objects.shape[2:])

    def log_likelihood(self, y: Array) -> Array:
        """(B,) log likelihood log P(Z | y) of everything seen since the anchor."""
        return self._log_likelihood(*self._states(y))

    def log_visibility(self, y: Array, *, soft: bool) -> Array:
        """(B,) log P(beta | x, O) of every keyframe since the anchor."""
        return self._log_visibility(*self._states(y), soft=soft)

    def log_target(self, y: Array) -> Array:
        """(B,) log P(Z, beta | y), with visibility as a hard test."""
        robots, objects = self._states(y)
        return self._log_likelihood(robots, objects) + self._log_visibility(robots, objects, soft=False)

    def energy(self, y: Array) -> Array:
        """(B,) energy that a mode minimises: -log P(Z | y) + |y|^2 / 2."""
        return 0.5 * squared_norms(y) - self.log_likelihood(y)

    def normal_equations(self, y: Array) -> tuple[Array, Array, Array]:
        """Energy (B,), gradient (B, size) and Gauss-Newton Hessian (B, size, size) in y."""
        moves, chart = self._joint.exp_and_jacobian(self._tangents(y))
        composed = self._composed(moves)
        robots, objects = self._moved(composed)
        by_robot, by_object = self._slopes(composed, chart)
        energy, residuals, jacobians = 0.5 * squared_norms(y), [], []
        for parts, sightings in self._linearised(robots, objects):
            for part in parts:
                energy += row_sums((0.5 * squared_norms(part.residual) - part.log_normaliser).reshape(len(y), -1))
            shape = (*robots.shape[:2], len(sightings), -1)
            together = _joined([part.jacobian_robot for part in parts]).reshape(*shape, self.layout.robot)
            jacobian = together @ self._timed(by_robot, sightings)
            together = _joined([part.jacobian_object for part in parts]).reshape(*shape, self.layout.landmark)
            jacobian[..., : self.width] += together @ self._placed(by_object, sightings)
            jacobians.append(jacobian.reshape(len(y), -1, self.size))
            residuals.append(_joined([part.residual for part in parts]).reshape(len(y), -1, 1))
        for time, gravity in self._levels:
            residual, slopes = gravity.residual(robots[:, :, time])
            energy -= gravity.log_likelihood(robots[:, :, time]).reshape(-1)
            whitened = np.concatenate([slopes @ by_robot[:, :, time], residual[..., None]], axis=-1)
            whitened = whitened.reshape(len(y), 2, -1) / np.sqrt(gravity.variance)
            jacobians.append(whitened[..., :-1])
            residuals.append(whitened[..., -1:])
        if not jacobians:
            return energy, y.copy(), broadcast_copy(np.eye(self.size), (len(y), self.size, self.size))
        jacobian, residual = _joined(jacobians), _joined(residuals)
        transposed = np.swapaxes(jacobian, -1, -2)
        hessian = transposed @ jacobian
        hessian.reshape(len(y), -1)[:, :: self.size + 1] += 1.0
        return energy, y + (transposed @ residual)[..., 0], hessian

    def _log_likelihood(self, robots: Array, objects: Array) -> Array:
        total = np.zeros(robots.shape[0] * robots.shape[1])
        for detections, sightings, named in self._parts:
            x, o = self._pairs(robots, objects, sightings)
            classes = self._repeated(sightings, robots.shape[1]) if named else None
            total += row_sums(self.model.log_likelihood(detections, x, o, classes).reshape(len(total), -1))
        for time, gravity in self._levels:
            total += gravity.log_likelihood(robots[:, :, time]).reshape(-1)
        return total

    def _log_visibility(self, robots: Array, objects: Array, *, soft: bool) -> Array:
        count = robots.shape[0] * robots.shape[1]
        if not len(self._times):
            return np.zeros(count)
        x, o = self._pairs(robots, objects, np.arange(len(self._times)))
        return row_sums(self.model.log_visibility(x, o, soft=soft).reshape(count, -1))

    def _linearised(self, robots: Array, objects: Array) -> list[tuple[list[Linearisation], Index]]:
        """Linearised geometry of all sightings, with semantics where they have a class, and which they are."""
        linearised = []
        for detections, sightings, named in self._parts:
            x, o = self._pairs(robots, objects, sightings)
            parts = [self.model.geometry(detections, x, o)]
            if named:
                parts.append(self.model.semantics(detections, x, o, self._repeated(sightings, robots.shape[1])))
            linearised.append((parts, sightings))
        return linearised

    def _pairs(self, robots: Array, objects: Array, sightings: Index) -> tuple[Array, Array]:
        """(K N S, s) robot and object of S sightings."""
        o = self._placed(objects, sightings)
        x = broadcast_copy(self._timed(robots, sightings), (*o.shape[:-1], robots.shape[-1]))
        return x.reshape(-1, x.shape[-1]), o.reshape(-1, o.shape[-1])

    def _timed(self, values: Array, sightings: Index) -> Array:
        """(K, N, S, ...) values of the sightings' robots, from (K, N, 1 + T, ...); S is 1 if all are the same."""
        times = self._times[sightings]
        return values[:, :, times[0] : times[0] + 1] if (times == times[0]).all() else values[:, :, times]

    def _placed(self, values: Array, sightings: Index) -> Array:
        """(K, N, S, ...) values of the sightings' objects, from (K, N, O, ...)."""
        places = self.places[:, sightings]
        if (places == places[:1]).all():
            in_order = np.array_equal(places[0], np.arange(values.shape[2]))
            return values if in_order else values[:, :, places[0]]
        rows, columns = np.arange(values.shape[0])[:, None, None], np.arange(values.shape[1])[:, None]
        return np.asarray(values[rows, columns, places[:, None]])

    def _repeated(self, sightings: Index, count: int) -> Index:
        """(K N S,) classes of the sightings, once for each of N states."""
        classes = self.classes[:, None, sightings]
        return broadcast_copy(classes, (len(classes), count, len(sightings))).reshape(-1)

    def _states(self, y: Array) -> tuple[Array, Array]:
        """(K, N, 1 + T, s) robot and (K, N, O, s) objects; headings are not wrapped."""
        return self._moved(self._composed(self._joint.exp(self._tangents(y))))

    def _tangents(self, y: Array) -> Array:
        """(K, N, 1 + O + T, w) tangent vectors: of robot and objects at the anchor, then of the motions."""
        y = y.reshape(len(self), -1, self.size)
        count = self._count
        tangents = np.empty((*y.shape[:2], count + len(self.links), self.layout.width))
        tangents[:, :, :count] = self.layout.blocks(y[..., : self.width] @ np.swapaxes(self.root, 1, 2))
        for t, root in enumerate(self.motion_roots):
            tangents[:, :, count + t, : self.layout.robot] = y[..., self.motion_rows(t)] @ root.T
        return tangents

    def _composed(self, moves: Array) -> Array:
        """(K, N, 1 + O + T, s) states at the anchor and motions since, from Exp of all tangents."""
        return self._joint.placed(self._frames[:, None], moves)

    def _moved(self, composed: Array) -> tuple[Array, Array]:
        """(K, N, 1 + T, s) robot and (K, N, O, s) objects."""
        count, size = self._count, self.spaces.storage.robot
        robots = np.empty((*composed.shape[:2], 1 + len(self.links), size))
        robots[:, :, 0] = composed[:, :, 0, :size]
        robots[:, :, 1:] = self.spaces.robot.along(composed[:, :, 0, :size], composed[:, :, count:, :size])
        return robots, composed[:, :, 1:count, : self.spaces.storage.landmark]

    def _slopes(self, composed: Array, chart: Array) -> tuple[Array, Array]:
        """Jacobians of tangents by y: (K, N, 1 + T, r, size) of the robot, (K, N, O, l, width) of the objects."""
        count, r, leading = self._count, self.layout.robot, composed.shape[:2]
        anchor = chart[:, :, :count] @ self.layout.blocks(self.root, -2)[:, None]
        robots = np.zeros((*leading, 1 + len(self.links), r, self.size))
        robots[:, :, 0, :, : self.width] = anchor[:, :, 0, :r]
        if self.links:
            motions = composed[:, :, count:, : self.spaces.storage.robot]
            transitions = self.spaces.robot.propagation(motions)
            steps = chart[:, :, count:, :r, :r] @ np.array(self.motion_roots)
        for t in range(len(self.links)):
            robots[:, :, t + 1] = transitions[..., t, :, :] @ robots[:, :, t]
            robots[:, :, t + 1, :, self.motion_rows(t)] += steps[:, :, t]
        return robots, anchor[:, :, 1:, : self.layout.landmark]


def _joined(parts: list[Array]) -> Array:
    """Arrays joined along the second axis."""
    return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=1)
