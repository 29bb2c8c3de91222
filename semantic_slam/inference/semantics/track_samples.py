"""Joint samples of a component's whole trajectory and its objects, and their update by one more keyframe.

A component's Gaussian is that of its factors linearised at the estimate. A continuation measures only the newest robot
pose and the objects that it associates; the samples of those are mapped by its mode and Hessian, and earlier poses
follow by regression on them (Matheron's rule), which is exact for Gaussians. By the same rule all samples follow a
measurement of gravity.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import gtsam
import numpy as np
from scipy.linalg import cho_solve, solve_triangular

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.spatial.gravity import Gravity
from semantic_slam.inference.models.step import Motion
from semantic_slam.inference.semantics.interface import SemanticInput
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.smoothing.errors import LostComponentError
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.identity import generator
from semantic_slam.inference.states.keys import object_key, robot_key
from semantic_slam.inference.states.spaces import Spaces


@dataclass(frozen=True)
class StateSamples:
    """P samples of all states of a component, as deviations in the tangent spaces at the estimate, M in total."""

    rows: dict[int, slice]  # GTSAM key -> coordinates of its tangent space
    mean: dict[int, Array]  # GTSAM key -> (s,)
    deviations: Array  # (P, M)
    root: Array  # (M, M) lower Cholesky factor of the information matrix

    @classmethod
    def of(cls, component: Component, num_samples: int, seed: int) -> "StateSamples":
        """Samples seeded by ``seed`` and the state; raises LostComponentError where the system is indeterminate."""
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
        spaces = {key: component.spaces.of(key) for key in keys}
        sizes = [space.tangent_size for space in spaces.values()]
        normals = np.concatenate(
            [_normals(seed, key, (num_samples, size)) for key, size in zip(keys, sizes, strict=True)], axis=1
        )
        deviations = solve_triangular(root, normals.T, lower=True, trans="T").T
        mean = {key: space.state(estimate, key) for key, space in spaces.items()}
        ends = np.cumsum(sizes).tolist()
        rows = {key: slice(end - size, end) for key, end, size in zip(keys, ends, sizes, strict=True)}
        return cls(rows, mean, deviations, root)

    def covariance_with(self, key: int) -> Array:
        """(M, d) covariance of all states with one of them."""
        rows = self.rows[key]
        unit = np.zeros((len(self.root), rows.stop - rows.start))
        unit[rows] = np.eye(unit.shape[1])
        return np.asarray(cho_solve((self.root, True), unit))


@dataclass(frozen=True)
class PredictedSamples:
    """Samples of a parent predicted to the next keyframe, before its measurements."""

    past: StateSamples
    ahead: Array  # (P, r + O l) deviations of the robot at the keyframe and of the objects
    gain: Array  # (M, r + O l) covariance of the past with them

    @classmethod
    def of(
        cls, component: Component, motion: Motion, object_ids: Sequence[int], new: dict[int, GaussianPrior],
        num_samples: int, seed: int,
    ) -> "PredictedSamples":  # fmt: skip
        """``object_ids`` names the objects in their order; those in ``new`` are not in the component yet."""
        past = StateSamples.of(component, num_samples, seed)
        robot = robot_key(component.keyframe)
        layout = component.spaces.layout
        transition = component.spaces.robot.propagation(motion.control)
        noise = np.linalg.cholesky(motion.covariance)
        step = _normals(seed, robot_key(component.keyframe + 1), (num_samples, layout.robot)) @ noise.T
        ahead = [past.deviations[:, past.rows[robot]] @ transition.T + step]
        gain = [past.covariance_with(robot) @ transition.T]
        with_robot = [transition @ gain[0][past.rows[robot]] + motion.covariance]
        for number in object_ids:
            key = object_key(number)
            if number in new:
                root = np.linalg.cholesky(new[number].covariance)
                ahead.append(_normals(seed, key, (num_samples, layout.landmark)) @ root.T)
                gain.append(np.zeros((len(past.root), layout.landmark)))
                with_robot.append(np.zeros((layout.landmark, layout.robot)))
            else:
                ahead.append(past.deviations[:, past.rows[key]])
                gain.append(past.covariance_with(key))
                with_robot.append(gain[0][past.rows[key]])
        predicted = cls(past, np.concatenate(ahead, axis=1), np.concatenate(gain, axis=1))
        if motion.gravity is None:
            return predicted
        moved = component.spaces.robot.compose(component.newest_robot(), motion.control)
        drawn = generator(seed, "gravity", 0, robot_key(component.keyframe + 1)).standard_normal((num_samples, 2))
        return predicted._given(motion.gravity, moved, np.concatenate(with_robot), drawn)

    def _given(self, gravity: Gravity, robot: Array, with_robot: Array, drawn: Array) -> "PredictedSamples":
        """The samples given a measurement of gravity, those ahead as deviations from the means that it shifts.

        ``robot`` (s,) is the mean before it, ``with_robot`` (r + O l, r) the covariance of the robot with what is
        ahead, and ``drawn`` (P, 2) are standard normal errors of the measurement.
        """
        (residual, slopes), r = gravity.residual(robot), with_robot.shape[1]
        ahead, past = with_robot @ slopes.T, self.gain[:, :r] @ slopes.T
        innovation = slopes @ ahead[:r] + gravity.variance * np.eye(2)
        off = self.ahead[:, :r] @ slopes.T + np.sqrt(gravity.variance) * drawn
        by_ahead, by_past = np.linalg.solve(innovation, ahead.T), np.linalg.solve(innovation, past.T)
        moved = self.past.deviations - (off + residual) @ by_past
        return PredictedSamples(
            past=replace(self.past, deviations=moved),
            ahead=self.ahead - off @ by_ahead,
            gain=self.gain - past @ by_ahead,
        )


@dataclass(frozen=True, kw_only=True)
class SampledRow:
    """P samples of one continuation: states at the keyframe, and through them of the past; n detections."""

    states: Array  # (P, 1 + n, s) robot and the objects of the detections' slots
    deviations: Array  # (P, 1 + n, w) from the mode, in the tangent spaces there
    change: Array  # (P, m) change of the samples by the measurements, whitened
    gain: Array  # (M, m) regression of the past on that change
    past: StateSamples
    spaces: Spaces

    @property
    def robots(self) -> Array:
        """(P, s) robot at the keyframe."""
        return self.states[:, 0, : self.spaces.storage.robot]

    def objects(self, slot: int) -> Array:
        """(P, s) object of a detection's slot."""
        return self.states[:, 1 + slot, : self.spaces.storage.landmark]

    def robot_at(self, keyframe: int) -> Array:
        """(P, s) robot at an earlier keyframe."""
        key = robot_key(keyframe)
        rows = self.past.rows[key]
        tangent = self.past.deviations[:, rows] + self.change @ self.gain[rows].T
        return self.spaces.robot.retract(self.past.mean[key], tangent)


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
    """The whitened prior samples y become y* + H^(-1/2) y, where y* is the mode and H its Hessian."""
    stack = given.stack
    layout = stack.layout
    own = stack.active[row] & (stack.slots[row] == np.arange(len(given.used)))
    blocks = np.concatenate([[0], np.where(own, 1 + stack.rows.objects[row], 0)])
    columns, used = layout.rows_of_slots(blocks[None])[0], layout.repeated(np.concatenate([[True], own]))
    ahead = np.where(used, predicted.ahead[:, columns], 0.0)
    before = solve_triangular(stack.root[row], ahead.T, lower=True)  # (m, P)
    curvature = np.linalg.cholesky(given.mode.hessian[row])
    after = given.mode.y[row][:, None] + solve_triangular(curvature, before, lower=True, trans="T")
    tangent = layout.blocks((stack.root[row] @ after).T)
    states = stack.spaces.joint.retract(stack.mean[row], tangent)
    gain = np.where(used, predicted.gain[:, columns], 0.0)
    whitened = solve_triangular(stack.root[row], gain.T, lower=True).T
    deviations = stack.spaces.joint.local(np.broadcast_to(mode, states.shape), states)
    return SampledRow(
        states=states,
        deviations=deviations,
        change=(after - before).T,
        gain=whitened,
        past=predicted.past,
        spaces=stack.spaces,
    )


def _normals(seed: int, key: int, shape: tuple[int, int]) -> Array:
    return generator(seed, "tracks", 0, key).standard_normal(shape)
