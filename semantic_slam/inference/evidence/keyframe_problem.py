"""Small problems, many at a time: robot and associated objects of B candidates under their Gaussian priors.

A candidate's states are x = mean * Exp(L y) with y ~ N(0, I), block by block: block 0 is the robot, block 1 + i
the object of detection i. A slot that a candidate does not use (clutter, or a second detection of the same
object) carries an independent standard normal that no measurement touches, so that it adds nothing.
"""

import copy
from dataclasses import dataclass
from typing import Any

import numpy as np

from semantic_slam.geometry.arrays import Array, Index, broadcast_copy, row_sums, squared_norms
from semantic_slam.geometry.rows import Selection, take
from semantic_slam.inference.models.observation import Linearisation, ObservationModel
from semantic_slam.inference.states.state_space import StateSpace


@dataclass(frozen=True)
class PredictedBelief:
    """Predicted Gaussians of P parents over the robot and O objects, covariances in the tangent spaces at the mean."""

    mean: Array  # (P, 1 + O, d)
    covariance: Array  # (P, (1 + O) d, (1 + O) d)

    @property
    def blocks(self) -> Array:
        """(P, 1 + O, d, 1 + O, d) the covariance by states."""
        shape = self.mean.shape[1:]
        return self.covariance.reshape(len(self.mean), *shape, *shape)

    def pair_covariances(self) -> Array:
        """(P, O, 2 d, 2 d) of the robot together with each object."""
        num_parents, dimension = len(self.mean), self.mean.shape[-1]
        count = self.mean.shape[1] - 1
        blocks = self.covariance.reshape(num_parents, 1 + count, dimension, 1 + count, dimension)
        objects = np.arange(1, 1 + count)
        joint = np.empty((num_parents, count, 2 * dimension, 2 * dimension))
        joint[..., :dimension, :dimension] = blocks[:, None, 0, :, 0]
        joint[..., dimension:, :dimension] = blocks[:, 1:, :, 0]
        joint[..., :dimension, dimension:] = np.swapaxes(joint[..., dimension:, :dimension], 2, 3)
        joint[..., dimension:, dimension:] = np.moveaxis(blocks[:, objects, :, objects], 0, 1)
        return joint


@dataclass(frozen=True)
class Assignments:
    """B candidates."""

    parents: Index  # (B,) into Predicted
    objects: Index  # (B, n) into its objects, -1 clutter
    classes: Index | None = None  # (B, n); None: geometry alone

    def take(self, selection: Selection) -> "Assignments":
        """The rows of a selection."""
        return take(self, selection)


class KeyframeProblem:
    """The likelihood of n detections over y (B, (1 + n) d), for the candidates of ``rows``."""

    def __init__(
        self, space: StateSpace, model: ObservationModel, seen: Any, rows: Assignments, mean: Array, root: Array
    ):
        """``seen``: the n detections as ``model`` collects them; ``root`` (B, (1 + n) d, (1 + n) d)."""
        self.space, self.model, self.rows = space, model, rows
        self.dimension = space.dimension
        self.seen = seen
        self.active = rows.objects >= 0
        self.slots = _first_occurrence(rows.objects)
        self._full = bool(self.active.all())
        self._distinct = bool((self.slots == np.arange(self.slots.shape[1])).all())
        self._frames, self.root = space.frame(mean), root
        self.size = mean.shape[1] * self.dimension

    @classmethod
    def of(
        cls, space: StateSpace, model: ObservationModel, predicted: PredictedBelief, seen: Any, rows: Assignments
    ) -> "KeyframeProblem":
        """With the priors of the candidates' states from those of their parents."""
        own = (rows.objects >= 0) & (_first_occurrence(rows.objects) == np.arange(rows.objects.shape[1]))
        blocks = np.concatenate([np.zeros((len(own), 1), int), np.where(own, 1 + rows.objects, 0)], axis=1)
        used = np.concatenate([np.ones((len(own), 1), bool), own], axis=1)
        dimension, count = space.dimension, blocks.shape[1] * space.dimension
        columns = (blocks[..., None] * dimension + np.arange(dimension)).reshape(len(own), count)
        covariance = predicted.covariance[rows.parents[:, None, None], columns[:, :, None], columns[:, None, :]]
        if not used.all():
            free = np.repeat(~used, dimension, axis=1)
            covariance = np.where(free[:, :, None] | free[:, None, :], np.eye(count), covariance)
        root = np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)
        return cls(space, model, seen, rows, predicted.mean[rows.parents[:, None], blocks], root)

    def with_classes(self, selection: Index, classes: Index) -> "KeyframeProblem":
        """Some of the candidates, with (B, n) classes of their objects."""
        part = self.select(selection)
        part.rows = Assignments(part.rows.parents, part.rows.objects, classes)
        return part

    def select(self, selection: Index) -> "KeyframeProblem":
        """Some of the candidates, without gathering their priors again."""
        part = self._of(selection)
        part._frames, part.root = self._frames[selection], self.root[selection]
        return part

    def _of(self, selection: Index) -> "KeyframeProblem":
        """The same with the priors of all."""
        part = copy.copy(self)
        part.rows = self.rows.take(selection)
        part.active, part.slots = self.active[selection], self.slots[selection]
        return part

    @property
    def mean(self) -> Array:
        """(B, 1 + n, d) prior means."""
        return self._frames[..., : self.dimension]

    def tangent(self, y: Array) -> Array:
        """(B, 1 + n, d) tangent vectors at the prior means."""
        return np.asarray((self.root @ y[..., None])[..., 0].reshape(self.mean.shape))

    def states(self, y: Array) -> Array:
        """(B, 1 + n, d) states."""
        return self.space.retract(self.mean, self.tangent(y))

    def marginals(self, y: Array, hessian: Array) -> tuple[Array, Array]:
        """(B, 1 + n, d) states and their (B, 1 + n, d, d) covariances, in the tangent spaces there."""
        tangent = self.tangent(y)
        covariance = self.root @ np.linalg.solve(hessian, np.swapaxes(self.root, -1, -2))
        count, dimension = self.mean.shape[1], self.dimension
        diagonal = np.einsum("bnpnq->bnpq", covariance.reshape(len(y), count, dimension, count, dimension))
        moved, chart = self.space.exp_and_jacobian(tangent)
        return self.space.compose(self.mean, moved), chart @ diagonal @ np.swapaxes(chart, -1, -2)

    def coordinates(self, states: Array) -> Array:
        """(B, n) whitened y of (B, 1 + n, d) states."""
        tangent = self.space.local(self.mean, states).reshape(len(states), -1)
        return np.asarray(np.linalg.solve(self.root, tangent[..., None])[..., 0])

    def objects_of(self, states: Array, detection: int) -> Array:
        """(B, d) states of the objects that detection ``detection`` is associated with."""
        return states[np.arange(len(states)), 1 + self.slots[:, detection]]

    def heading_sigma(self, detection: int) -> Array:
        """(B,) prior standard deviation of the last coordinate of a detection's object: the heading of a pose."""
        row = (1 + self.slots[:, detection]) * self.dimension + self.dimension - 1
        return np.asarray(np.linalg.norm(self.root[np.arange(len(row)), row], axis=-1))

    def log_likelihood(self, y: Array) -> Array:
        """(B,) log P(Z | x, O, C), Eq. 4.10."""
        if not self.rows.objects.shape[1]:
            return np.zeros(len(y))
        x, o = self._pairs(self._states(y))
        return row_sums(self._by_row(self.model.log_likelihood(self.seen, x, o, self._classes())))

    def log_joint(self, y: Array) -> Array:
        """(B, N) log P(Z, beta | x, O, C) - |y|^2 / 2 at N states of each candidate, y (B, N, size)."""
        tangent = (y @ np.swapaxes(self.root, 1, 2)).reshape(*y.shape[:2], *self.mean.shape[1:])
        states = self.space.placed(self._frames[:, None], self.space.exp(tangent))
        states = states.reshape(-1, *self.mean.shape[1:])
        many = self._of(np.repeat(np.arange(len(y)), y.shape[1]))
        x, o = many._pairs(states)
        logs = self.model.log_visibility(x, o, soft=False) + self.model.log_likelihood(self.seen, x, o, many._classes())
        return row_sums(many._by_row(logs)).reshape(y.shape[:2]) - 0.5 * squared_norms(y)

    def energy(self, y: Array) -> Array:
        """(B,) -log P(Z | y) + |y|^2 / 2."""
        return 0.5 * squared_norms(y) - self.log_likelihood(y)

    def normal_equations(self, y: Array) -> tuple[Array, Array, Array]:
        """Energy (B,), gradient (B, size) and Gauss-Newton Hessian (B, size, size) in y."""
        tangent = self.tangent(y)
        energy = 0.5 * squared_norms(y)
        moved, chart = self.space.exp_and_jacobian(tangent)
        parts = self._parts(self.space.placed(self._frames, moved))
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

    def _in_y(self, chart: Array, parts: list[Linearisation]) -> Array:
        """(B, n m, size) derivatives of all residuals, given those of the states (B, 1 + n, d, d)."""
        by_robot = self._by_row(np.concatenate([part.jacobian_robot for part in parts], axis=1))
        by_object = self._by_row(np.concatenate([part.jacobian_object for part in parts], axis=1))
        slopes = chart @ self.root.reshape(*self.mean.shape, self.size)
        own = slopes[:, 1:] if self._distinct else slopes[np.arange(len(slopes))[:, None], 1 + self.slots]
        found = by_robot @ slopes[:, :1]
        found += by_object @ own
        return found.reshape(len(chart), -1, self.size)

    def log_visibility(self, y: Array, *, soft: bool) -> Array:
        """(B,) log P(beta | x, O) over the associated objects."""
        if not self.rows.objects.shape[1]:
            return np.zeros(len(y))
        x, o = self._pairs(self._states(y))
        return row_sums(self._by_row(self.model.log_visibility(x, o, soft=soft)))

    def _states(self, y: Array) -> Array:
        """(B, 1 + n, d) states, headings as they add up: for likelihoods."""
        return self.space.placed(self._frames, self.space.exp(self.tangent(y)))

    def _pairs(self, states: Array) -> tuple[Array, Array]:
        """(B n, d) robot and object of every detection of every candidate."""
        own = states[:, 1:] if self._distinct else states[np.arange(len(states))[:, None], 1 + self.slots]
        robots = broadcast_copy(states[:, :1], own.shape)
        return robots.reshape(-1, self.dimension), own.reshape(-1, self.dimension)

    def _classes(self) -> Index | None:
        if self.rows.classes is None or self.model.num_classes == 0:
            return None
        return np.maximum(self.rows.classes, 0).ravel()

    def _parts(self, states: Array) -> list[Linearisation]:
        if not self.rows.objects.shape[1]:
            return []
        x, o = self._pairs(states)
        parts, classes = [self.model.geometry(self.seen, x, o)], self._classes()
        if classes is not None:
            parts.append(self.model.semantics(self.seen, x, o, classes))
        return parts

    def _by_row(self, values: Array) -> Array:
        """(B n, ...) values of the detections to (B, n, ...), 0 for clutter."""
        shaped = values.reshape(*self.active.shape, *values.shape[1:])
        if self._full:
            return shaped
        return np.where(self.active.reshape(*self.active.shape, *(1,) * (values.ndim - 1)), shaped, 0.0)


def search_start(stack: KeyframeProblem) -> Array:
    """(B, n) the best of the prior mean and the robot states that explain one detection each."""
    best = np.zeros((len(stack.mean), stack.size))
    if len(best) == 0:
        return best
    least = stack.energy(best)
    dimension = stack.dimension
    robot = stack.mean[:, 0]
    for number in range(stack.rows.objects.shape[1]):
        wanted = stack.model.robot_start(stack.seen.take([number]), robot, stack.objects_of(stack.mean, number))
        start = np.zeros_like(best)
        tangent = stack.space.local(robot, wanted)
        start[:, :dimension] = np.linalg.solve(stack.root[:, :dimension, :dimension], tangent[..., None])[..., 0]
        energy = np.where(stack.active[:, number], stack.energy(start), np.inf)
        better = energy < least
        best[better], least = start[better], np.minimum(least, energy)
    return best


def _first_occurrence(objects: Index) -> Index:
    """(B, n) slot of each detection: its own, or that of the first detection of the same object."""
    if objects.shape[1] == 0:
        return objects
    same = objects[:, :, None] == objects[:, None, :]
    return np.asarray(np.argmax(same, axis=2))
