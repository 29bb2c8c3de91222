"""Batched nonlinear least-squares problems: robot and associated objects of B candidates, with Gaussian priors.

A candidate's states are x = mean * Exp(L y) with whitened y ~ N(0, I), block by block: block 0 is the robot, block
1 + i the object of detection i. A slot that a candidate does not use (clutter, or a second detection of the same
object) is a dummy: an independent standard normal without measurements, which contributes nothing.
"""

import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from semantic_slam.geometry.arrays import Array, Index, broadcast_copy, row_sums, squared_norms
from semantic_slam.inference.evidence.assignments import Assignments
from semantic_slam.inference.models.observation import Linearisation, ObservationModel
from semantic_slam.inference.states.layout import Layout
from semantic_slam.inference.states.spaces import Spaces


@dataclass(frozen=True)
class PredictedBelief:
    """Predicted Gaussians of P parents over robot and O objects; covariances in the tangent spaces at the means."""

    layout: Layout  # of the tangent spaces: r, l, and w the wider of them
    mean: Array  # (P, 1 + O, s)
    covariance: Array  # (P, r + O l, r + O l)

    @cached_property
    def blocks(self) -> Array:
        """(P, 1 + O, w, 1 + O, w) predicted covariance in blocks by state."""
        return self.layout.square_blocks(self.covariance)

    @cached_property
    def pair_covariances(self) -> Array:
        """(P, O, r + l, r + l) joint covariances of the robot with each object."""
        r, own, shape = self.layout.robot, self.layout.landmark, (len(self.mean), self.mean.shape[1] - 1)
        landmarks = self.covariance[:, r:, r:].reshape(*shape, own, shape[1], own)
        joint = np.empty((*shape, r + own, r + own))
        joint[..., :r, :r] = self.covariance[:, None, :r, :r]
        joint[..., r:, :r] = self.covariance[:, r:, :r].reshape(*shape, own, r)
        joint[..., :r, r:] = np.swapaxes(joint[..., r:, :r], 2, 3)
        joint[..., r:, r:] = np.einsum("bnpnq->bnpq", landmarks)
        return joint


class KeyframeProblem:
    """The likelihood of n detections over y (B, r + n l), for the candidates of ``rows``.

    States are in blocks (B, 1 + n, s), tangent vectors (B, 1 + n, w), as wide as the wider of robot and landmark.
    """

    def __init__(
        self,
        spaces: Spaces,
        model: ObservationModel,
        detections: Any,
        rows: Assignments,
        mean: Array,
        root: Array,
        log_clutter: Array | None = None,
    ):
        """``detections``: the n detections as ``model`` collects them; ``root`` (B, r + n l, r + n l).

        ``log_clutter`` (n,): log density of each detection as clutter; None: clutter contributes 0.
        """
        self.spaces, self.layout, self.model, self.rows = spaces, spaces.layout, model, rows
        self._joint = spaces.joint
        self.detections = detections
        self.active = rows.objects >= 0
        self.slots = _first_occurrence(rows.objects)
        self.log_clutter = np.zeros(len(self.active))  # (B,) summed over each candidate's clutter detections
        if log_clutter is not None:
            self.log_clutter = row_sums(np.where(self.active, 0.0, log_clutter))
        self._full = bool(self.active.all())
        self._distinct = bool((self.slots == np.arange(self.slots.shape[1])).all())
        self._frames, self.root = self._joint.frame(mean), root
        self.size = root.shape[-1]

    @classmethod
    def of(
        cls,
        spaces: Spaces,
        model: ObservationModel,
        predicted: PredictedBelief,
        detections: Any,
        rows: Assignments,
        log_clutter: Array | None = None,
    ) -> "KeyframeProblem":
        """Problem of the candidates, with the priors of their states from those of their parents."""
        is_first = (rows.objects >= 0) & (_first_occurrence(rows.objects) == np.arange(rows.objects.shape[1]))
        blocks = np.concatenate([np.zeros((len(is_first), 1), int), np.where(is_first, 1 + rows.objects, 0)], axis=1)
        used = np.concatenate([np.ones((len(is_first), 1), bool), is_first], axis=1)
        columns = spaces.layout.rows_of_slots(blocks)
        covariance = predicted.covariance[rows.parents[:, None, None], columns[:, :, None], columns[:, None, :]]
        if not used.all():
            free = spaces.layout.repeated(~used)
            covariance = np.where(free[:, :, None] | free[:, None, :], np.eye(columns.shape[1]), covariance)
        root = np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)
        return cls(spaces, model, detections, rows, predicted.mean[rows.parents[:, None], blocks], root, log_clutter)

    def with_classes(self, selection: Index, classes: Index) -> "KeyframeProblem":
        """The problem of the chosen candidates, with (B, n) classes of their objects."""
        part = self.select(selection)
        part.rows = Assignments(parents=part.rows.parents, objects=part.rows.objects, classes=classes)
        return part

    def select(self, selection: Index) -> "KeyframeProblem":
        """The problem of the chosen candidates, with their priors."""
        part = self._of(selection)
        part._frames, part.root = self._frames[selection], self.root[selection]
        return part

    def _of(self, selection: Index) -> "KeyframeProblem":
        """The problem of the chosen candidates, but with the priors of all: for internal use."""
        part = copy.copy(self)
        part.rows = self.rows.take(selection)
        part.active, part.slots = self.active[selection], self.slots[selection]
        part.log_clutter = self.log_clutter[selection]
        return part

    @property
    def mean(self) -> Array:
        """(B, 1 + n, s) prior means of robot and objects."""
        return self._frames[..., : self.spaces.storage.width]

    def tangent(self, y: Array) -> Array:
        """(B, 1 + n, w) tangent vectors at the prior means."""
        return self.layout.blocks((self.root @ y[..., None])[..., 0])

    def states(self, y: Array) -> Array:
        """(B, 1 + n, s) states of robot and objects at whitened variables ``y``."""
        return self._joint.retract(self.mean, self.tangent(y))

    def marginals(self, y: Array, hessian: Array) -> tuple[Array, Array, Array]:
        """(B, 1 + n, s) states and their (B, 1 + n, w, w) covariances, in the tangent spaces there.

        The third array (B, 1 + n, r, w) holds the covariances of the robot with each state.
        """
        tangent = self.tangent(y)
        covariance = self.root @ np.linalg.solve(hessian, np.swapaxes(self.root, -1, -2))
        moved, chart = self._joint.exp_and_jacobian(tangent)
        diagonal = self.layout.diagonal(covariance)
        back, r = np.swapaxes(chart, -1, -2), self.layout.robot
        of_robot = np.swapaxes(self.layout.blocks(covariance[:, :r]), 1, 2)
        crosses = chart[:, :1, :r, :r] @ of_robot @ back
        return self._joint.compose(self.mean, moved), chart @ diagonal @ back, crosses

    def coordinates(self, states: Array) -> Array:
        """(B, size) whitened y of (B, 1 + n, s) states."""
        tangent = self.layout.joined(self._joint.local(self.mean, states))
        return np.asarray(np.linalg.solve(self.root, tangent[..., None])[..., 0])

    def robots_of(self, states: Array) -> Array:
        """(B, s) robots among (B, 1 + n, s) states."""
        return states[:, 0, : self.spaces.storage.robot]

    def objects_of(self, states: Array, detection: int) -> Array:
        """(B, s) states of the objects that detection ``detection`` is associated with."""
        return states[np.arange(len(states)), 1 + self.slots[:, detection], : self.spaces.storage.landmark]

    def heading_rows(self, detection: int) -> Index | None:
        """(B,) indices of the heading coordinates (about own z) of a detection's objects; None if objects have none."""
        turn = self.spaces.landmark.own_turn
        return None if turn is None else self.layout.starts(1 + self.slots[:, detection]) + turn

    def heading_sigma(self, detection: int) -> Array:
        """(B,) prior standard deviation of the heading of a detection's object, 0 if objects have none."""
        rows = self.heading_rows(detection)
        if rows is None:
            return np.zeros(len(self.root))
        return np.asarray(np.linalg.norm(self.root[np.arange(len(rows)), rows], axis=-1))

    def log_likelihood(self, y: Array) -> Array:
        """(B,) log P(Z | x, O, C), Eq. 4.10."""
        if not self.rows.objects.shape[1]:
            return np.zeros(len(y))
        x, o = self._pairs(self._states(y))
        return self.log_clutter + row_sums(
            self._by_row(self.model.log_likelihood(self.detections, x, o, self._classes()))
        )

    def log_joint(self, y: Array) -> Array:
        """(B, N) log P(Z, beta | x, O, C) - |y|^2 / 2 at N states of each candidate, y (B, N, size)."""
        tangent = self.layout.blocks(y @ np.swapaxes(self.root, 1, 2))
        states = self._joint.placed(self._frames[:, None], self._joint.exp(tangent))
        states = states.reshape(-1, *states.shape[2:])
        many = self._of(np.repeat(np.arange(len(y)), y.shape[1]))
        x, o = many._pairs(states)
        logs = self.model.log_visibility(x, o, soft=False) + self.model.log_likelihood(
            self.detections, x, o, many._classes()
        )
        return (many.log_clutter + row_sums(many._by_row(logs))).reshape(y.shape[:2]) - 0.5 * squared_norms(y)

    def energy(self, y: Array) -> Array:
        """(B,) energy that a mode minimises: -log P(Z | y) + |y|^2 / 2."""
        return 0.5 * squared_norms(y) - self.log_likelihood(y)

    def normal_equations(self, y: Array) -> tuple[Array, Array, Array]:
        """Energy (B,), gradient (B, size) and Gauss-Newton Hessian (B, size, size) in y."""
        tangent = self.tangent(y)
        energy = 0.5 * squared_norms(y) - self.log_clutter
        moved, chart = self._joint.exp_and_jacobian(tangent)
        parts = self._parts(self._joint.placed(self._frames, moved))
        if not parts:
            return energy, y.copy(), broadcast_copy(np.eye(self.size), (len(y), self.size, self.size))
        for part in parts:
            energy += row_sums(self._by_row(0.5 * squared_norms(part.residual) - part.log_normaliser))
        residual = self._by_row(np.concatenate([part.residual for part in parts], axis=1)).reshape(len(y), -1)
        jacobian = self._in_y(chart, parts)
        transposed = np.swapaxes(jacobian, -1, -2)
        gradient = y + (transposed @ residual[..., None])[..., 0]
        hessian = transposed @ jacobian
        hessian.reshape(len(y), -1)[:, :: self.size + 1] += 1.0
        return energy, gradient, hessian

    def geometry_rows(self, y: Array) -> tuple[Array, Array]:
        """Whitened residuals (B, n, m) of geometry alone and their derivatives (B, n, m, size) by y; 0 for clutter."""
        moved, chart = self._joint.exp_and_jacobian(self.tangent(y))
        part = self.model.geometry(self.detections, *self._pairs(self._joint.placed(self._frames, moved)))
        residual = self._by_row(part.residual)
        return residual, self._in_y(chart, [part]).reshape(*residual.shape, self.size)

    def _in_y(self, chart: Array, parts: list[Linearisation]) -> Array:
        """(B, n m, size) derivatives of all residuals by y; ``chart`` (B, 1 + n, w, w): Jacobians of the retraction."""
        by_robot = self._by_row(np.concatenate([part.jacobian_robot for part in parts], axis=1))
        by_object = self._by_row(np.concatenate([part.jacobian_object for part in parts], axis=1))
        slopes = chart @ self.layout.blocks(self.root, -2)
        object_slopes = slopes[:, 1:] if self._distinct else slopes[np.arange(len(slopes))[:, None], 1 + self.slots]
        slopes_by_row = by_robot @ slopes[:, :1, : self.layout.robot]
        slopes_by_row += by_object @ object_slopes[:, :, : self.layout.landmark]
        return slopes_by_row.reshape(len(chart), -1, self.size)

    def log_visibility(self, y: Array, *, soft: bool) -> Array:
        """(B,) log P(beta | x, O) over the associated objects."""
        if not self.rows.objects.shape[1]:
            return np.zeros(len(y))
        x, o = self._pairs(self._states(y))
        return row_sums(self._by_row(self.model.log_visibility(x, o, soft=soft)))

    def _states(self, y: Array) -> Array:
        """(B, 1 + n, s) states with headings not wrapped, for likelihoods."""
        return self._joint.placed(self._frames, self._joint.exp(self.tangent(y)))

    def _pairs(self, states: Array) -> tuple[Array, Array]:
        """(B n, s) robot and object of every detection of every candidate."""
        size, own_size = self.spaces.storage.robot, self.spaces.storage.landmark
        objects = states[:, 1:] if self._distinct else states[np.arange(len(states))[:, None], 1 + self.slots]
        robots = broadcast_copy(states[:, :1, :size], (*objects.shape[:2], size))
        return robots.reshape(-1, size), objects[..., :own_size].reshape(-1, own_size)

    def _classes(self) -> Index | None:
        if self.rows.classes is None or self.model.num_classes == 0:
            return None
        return np.where(self.active, self.rows.classes, 0).ravel()

    def _parts(self, states: Array) -> list[Linearisation]:
        if not self.rows.objects.shape[1]:
            return []
        x, o = self._pairs(states)
        parts, classes = [self.model.geometry(self.detections, x, o)], self._classes()
        if classes is not None:
            parts.append(self.model.semantics(self.detections, x, o, classes))
        return parts

    def _by_row(self, values: Array) -> Array:
        """(B n, ...) values of the detections to (B, n, ...), 0 for clutter."""
        shaped = values.reshape(*self.active.shape, *values.shape[1:])
        if self._full:
            return shaped
        return np.where(self.active.reshape(*self.active.shape, *(1,) * (values.ndim - 1)), shaped, 0.0)


def _first_occurrence(objects: Index) -> Index:
    """(B, n) slot of each detection: its own, or that of the first detection of the same object."""
    if objects.shape[1] == 0:
        return objects
    same = objects[:, :, None] == objects[:, None, :]
    return np.asarray(np.argmax(same, axis=2))
