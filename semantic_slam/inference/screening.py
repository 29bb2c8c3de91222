"""Partial associations of which one linear step tells enough are not searched for their modes.

Those that it shows to be far off are dropped; those that hardly bend are ranked by it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.small_matrices import backward, cholesky, forward
from semantic_slam.inference.laplace import Mode, search_start
from semantic_slam.inference.stack import Stack

Array = NDArray[np.float64]
Index = NDArray[np.int_]
Flags = NDArray[np.bool_]

RANKED_RAD = 0.1
"""Uncertainty of a direction of sight, given other detections, below which one linear step ranks as a search does."""
STEADY_RAD = 0.2
"""Uncertainty of a direction of sight, given other detections, below which one linear step tells what is far off."""
LOST_RAD = 0.3
"""Uncertainty from which on the expected state may lead to another mode than the best."""
SAFETY = 2.0
"""A linear step's nats count half: so much may the rest of the nonlinearity change them."""


@dataclass(frozen=True)
class Screened:
    """What is left of B candidates."""

    kept: Index  # (K,)
    mode: Mode  # K, as one linear step has it where that ranks; else with the state to search from
    searched: Index  # those of K whose modes are to be searched
    log_left_out: Array  # (P,) of the others, relative to the parent's best that one linear step tells


def screen(stack: Stack, previous: Mode, origin: Index, gate: float, num_parents: int) -> Screened:
    """Drop candidates whose evidence one step from where they were puts far behind, where that step can be trusted.

    ``previous`` are modes of all detections but the newest, ``origin`` (B,) says whose each candidate goes on from. Of
    those not dropped, the steady ones start at that step, lost ones at what explains most, the rest where they were.
    """
    added = _added(stack, previous, origin)
    linear = added.sigma < STEADY_RAD
    evidence = previous.log_evidence[origin] + added.log_density
    best = np.full(num_parents, -np.inf)
    parents = stack.rows.parents
    np.maximum.at(best, parents[linear], evidence[linear])
    behind = evidence - best[parents]
    dropped = linear & (behind < -SAFETY * gate)
    left_out = np.full(num_parents, -np.inf)
    np.logaddexp.at(left_out, parents[dropped], behind[dropped])
    kept = np.flatnonzero(~dropped)
    start, lost = added.start[kept], np.flatnonzero(added.sigma[kept] > LOST_RAD)
    start[linear[kept]] += added.step[kept[linear[kept]]]
    if len(lost):
        start[lost] = _better_start(stack.select(kept[lost]), start[lost])
    mode = Mode(start, added.hessian(previous, origin, kept), evidence[kept])
    return Screened(kept, mode, np.flatnonzero(added.sigma[kept] >= RANKED_RAD), left_out)


@dataclass(frozen=True)
class _Added:
    """The newest detection of B candidates, linearised at the mode of the others."""

    start: Array  # (B, n) that mode, a new object where it is expected from there
    step: Array  # (B, n) from there to the mode of all
    log_density: Array  # (B,) of the detection given the others
    sigma: Array  # (B,) radians by which the direction of sight is uncertain, given the others
    jacobian: Array  # (B, m, n) of its whitened residual

    def hessian(self, previous: Mode, origin: Index, kept: Index) -> Array:
        """(K, n, n) of all, of some rows."""
        own, size = self.jacobian[kept], previous.y.shape[1]
        total = np.swapaxes(own, 1, 2) @ own
        total[:, :size, :size] += previous.hessian[origin[kept]]
        new = np.arange(size, total.shape[1])
        total[:, new, new] += 1.0
        return np.asarray(total)


def _added(stack: Stack, previous: Mode, origin: Index) -> _Added:
    """One Kalman update for each candidate: the others' Hessian tells what they left uncertain."""
    rows, number = np.arange(len(origin)), stack.rows.objects.shape[1] - 1
    start = np.zeros((len(rows), stack.size))
    start[:, : previous.y.shape[1]] = previous.y[origin]
    both = np.stack([np.zeros(len(rows), dtype=int), 1 + stack.slots[:, number]], axis=1)
    x, o, slopes = _newest(stack, start, both)
    spread = _times_covariance(np.asarray(np.linalg.inv(previous.hessian)), origin, slopes)  # (B, n, 2 d)
    part = stack.model.geometry(stack.seen.take([number]), x, o)
    jacobian = np.concatenate([part.jacobian_robot, part.jacobian_object], axis=-1)
    covariance = slopes @ spread
    innovation = jacobian @ covariance @ np.swapaxes(jacobian, 1, 2) + np.eye(jacobian.shape[1])
    root = cholesky(innovation)
    whitened = forward(root, part.residual[..., None])
    gain = backward(root, whitened)
    log_determinant = np.log(np.einsum("bii->bi", root)).sum(-1)
    log_density = part.log_normaliser - 0.5 * (whitened[..., 0] ** 2).sum(-1) - log_determinant
    step = -(spread @ (np.swapaxes(jacobian, 1, 2) @ gain))[..., 0]
    return _Added(start, step, log_density, stack.model.sight_sigma(x, o, covariance), jacobian @ slopes)


def _newest(stack: Stack, y: Array, blocks: Index) -> tuple[Array, Array, Array]:
    """Robot (B, d) and object, and (B, 2 d, n) derivatives of both by y; ``blocks`` (B, 2) are theirs."""
    rows = np.arange(len(y))[:, None]
    root = stack.root.reshape(*stack.mean.shape, stack.size)[rows, blocks]  # (B, 2, d, n)
    tangent = (root @ y[:, None, :, None])[..., 0]
    moved, chart = stack.manifold.exp_and_jacobian(tangent)
    states, slopes = stack.manifold.compose(stack.mean[rows, blocks], moved), chart @ root
    return states[:, 0], states[:, 1], slopes.reshape(len(y), -1, stack.size)


def _times_covariance(known: Array, origin: Index, slopes: Array) -> Array:
    """(B, n, 2 d) covariance of y times slopes: ``known[origin]`` of its first coordinates, the others being free."""
    size = known.shape[-1]
    spread = np.ascontiguousarray(np.swapaxes(slopes, 1, 2))
    spread[:, :size] = known[origin] @ spread[:, :size]
    return spread


def _better_start(stack: Stack, carried: Array) -> Array:
    """The mode of the detections so far, or a start that explains one detection: whichever fits better."""
    fresh = search_start(stack)
    better = stack.energy(carried) <= stack.energy(fresh)
    return np.where(better[:, None], carried, fresh)
