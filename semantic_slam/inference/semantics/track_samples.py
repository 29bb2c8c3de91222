"""Joint samples of a component's whole trajectory and its objects, and what they become with one more keyframe.

A component's Gaussian is that of its factors linearised at the estimate. A continuation measures only the newest
robot pose and the objects that it associates; what it makes of the samples of those follows from its mode, and
the earlier poses follow by their regression on them (Matheron's rule), which is exact for Gaussians.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import gtsam
import numpy as np
from scipy.linalg import cho_solve, solve_triangular

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.step import Motion
from semantic_slam.inference.semantics.interface import SemanticInput
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.smoothing.errors import LostComponentError
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.identity import generator
from semantic_slam.inference.states.keys import object_key, robot_key
from semantic_slam.inference.states.state_space import StateSpace


@dataclass(frozen=True)
class StateSamples:
    """P samples of N states of a component, as deviations from the estimate in its tangent spaces."""

    rows: dict[int, int]  # GTSAM key -> row
    mean: Array  # (N, d)
    deviations: Array  # (P, N, d)
    root: Array  # (N d, N d) lower Cholesky factor of the information matrix

    @classmethod
    def of(cls, component: Component, num_samples: int, seed: int) -> "StateSamples":
        """Draws keyed by ``seed`` and the state; raises LostComponentError where the system is indeterminate."""
        estimate = component.smoother.isam.calculateEstimate()
        keys = sorted(estimate.keys())
        ordering = gtsam.Ordering()
        for key in keys:
            ordering.push_back(key)
        linear = gtsam.NonlinearFactorGraph(component.smoother.isam.getFactorsUnsafe()).linearize(estimate)
        try:
            root: Array = np.linalg.cholesky(np.asarray(linear.hessian(ordering)[0], dtype=np.float64))
        except np.linalg.LinAlgError:
            raise LostComponentError("the information matrix is not positive definite") from None
        dimension = component.space.dimension
        normals = np.concatenate([_normals(seed, key, (num_samples, dimension)) for key in keys], axis=1)
        deviations = solve_triangular(root, normals.T, lower=True, trans="T").T
        mean = np.array([component.space.state(estimate, key) for key in keys])
        rows = {key: row for row, key in enumerate(keys)}
        return cls(rows, mean, deviations.reshape(num_samples, len(keys), dimension), root)

    def covariance_with(self, keys: Sequence[int]) -> Array:
        """(N, d, n d) covariance of all states with some."""
        size = self.mean.shape[1]
        unit = np.zeros((self.mean.size, len(keys) * size))
        for column, key in enumerate(keys):
            place = slice(self.rows[key] * size, (self.rows[key] + 1) * size)
            unit[place, column * size : (column + 1) * size] = np.eye(size)
        covariance: Array = cho_solve((self.root, True), unit)
        return covariance.reshape(*self.mean.shape, -1)


@dataclass(frozen=True)
class PredictedSamples:
    """Samples of a parent carried to the next keyframe, before its measurements."""

    past: StateSamples
    ahead: Array  # (P, 1 + O, d) deviations of the robot at the keyframe and of the objects
    gain: Array  # (N, d, (1 + O) d) covariance of the past with them

    @classmethod
    def of(
        cls, component: Component, motion: Motion, object_ids: Sequence[int], new: dict[int, GaussianPrior],
        num_samples: int, seed: int,
    ) -> "PredictedSamples":  # fmt: skip
        """``object_ids`` names the objects in their order; those in ``new`` are not in the component yet."""
        past = StateSamples.of(component, num_samples, seed)
        robot = robot_key(component.keyframe)
        size = component.space.dimension
        transition = component.space.propagation(motion.control)
        noise = np.linalg.cholesky(motion.covariance)
        step = _normals(seed, robot_key(component.keyframe + 1), (num_samples, size)) @ noise.T
        ahead = [past.deviations[:, past.rows[robot]] @ transition.T + step]
        gain = [past.covariance_with([robot]) @ transition.T]
        for number in object_ids:
            key = object_key(number)
            if number in new:
                root = np.linalg.cholesky(new[number].covariance)
                ahead.append(_normals(seed, key, (num_samples, size)) @ root.T)
                gain.append(np.zeros((*past.mean.shape, size)))
            else:
                ahead.append(past.deviations[:, past.rows[key]])
                gain.append(past.covariance_with([key]))
        return cls(past, np.stack(ahead, axis=1), np.concatenate(gain, axis=-1))


@dataclass(frozen=True)
class SampledRow:
    """P samples of one continuation: states at the keyframe and, from them, of the past; n detections."""

    states: Array  # (P, 1 + n, d) robot and the objects of the detections' slots
    deviations: Array  # (P, 1 + n, d) from the mode, in the tangent spaces there
    change: Array  # (P, m) what the measurements changed about the samples, whitened
    gain: Array  # (N, d, m) how the past follows
    past: StateSamples
    space: StateSpace

    def robot_at(self, keyframe: int) -> Array:
        """(P, d) robot at an earlier keyframe."""
        place = self.past.rows[robot_key(keyframe)]
        tangent = self.past.deviations[:, place] + self.change @ self.gain[place].T
        return self.space.retract(self.past.mean[place], tangent)


def sample_rows(given: SemanticInput, num_samples: int, seed: int) -> list[SampledRow]:
    """Samples of every continuation. Raises LostComponentError."""
    parents = [
        PredictedSamples.of(parent, given.step.motion, given.object_ids, new, num_samples, seed)
        for parent, new in zip(given.parents, given.new, strict=True)
    ]
    modes = given.stack.states(given.mode.y)
    of_rows = given.stack.rows.parents
    return [_sampled_row(given, parents[of_rows[row]], row, modes[row]) for row in range(len(modes))]


def _sampled_row(given: SemanticInput, predicted: PredictedSamples, row: int, mode: Array) -> SampledRow:
    """The prior's whitened samples y become y* + H^(-1/2) y, where y* is the mode and H its Hessian."""
    stack = given.stack
    count, size = len(predicted.ahead), stack.dimension
    own = stack.active[row] & (stack.slots[row] == np.arange(len(given.used)))
    blocks = np.concatenate([[0], np.where(own, 1 + stack.rows.objects[row], 0)])
    used = np.concatenate([[True], own])
    ahead = np.where(used[:, None], predicted.ahead[:, blocks], 0.0).reshape(count, -1)
    before = solve_triangular(stack.root[row], ahead.T, lower=True)  # (m, P)
    curvature = np.linalg.cholesky(given.mode.hessian[row])
    after = given.mode.y[row][:, None] + solve_triangular(curvature, before, lower=True, trans="T")
    tangent = (stack.root[row] @ after).T.reshape(count, -1, size)
    states = stack.space.retract(stack.mean[row], tangent)
    columns = (blocks[:, None] * size + np.arange(size)).ravel()
    gain = np.where(np.repeat(used, size), predicted.gain[..., columns], 0.0)
    whitened = solve_triangular(stack.root[row], gain.reshape(-1, len(columns)).T, lower=True).T.reshape(gain.shape)
    deviations = stack.space.local(np.broadcast_to(mode, states.shape), states)
    return SampledRow(states, deviations, (after - before).T, whitened, predicted.past, stack.space)


def _normals(seed: int, key: int, shape: tuple[int, int]) -> Array:
    return generator(seed, "tracks", 0, key).standard_normal(shape)
