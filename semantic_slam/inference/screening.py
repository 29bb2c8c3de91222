"""Partial associations that one linear step shows to be far off are not searched for their modes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semantic_slam.inference.laplace import search_start
from semantic_slam.inference.observation import ObservationModel
from semantic_slam.inference.stack import Predicted, Stack

Array = NDArray[np.float64]
Index = NDArray[np.int_]
Flags = NDArray[np.bool_]

STEADY_RAD = 0.1
"""Uncertainty of a direction of sight below which one linear step tells what is far off."""
LOST_RAD = 0.3
"""Uncertainty from which on the expected state may lead to another mode than the best."""
SAFETY = 2.0
"""A linear step's nats count half: so much may the rest of the nonlinearity change them."""


@dataclass(frozen=True)
class Screened:
    """What is left of B candidates."""

    kept: Index  # (K,)
    start: Array  # (K, n) whitened states to search modes from
    log_left_out: Array  # (P,) of the others, relative to the parent's best that one linear step tells


def sight_sigmas(model: ObservationModel, predicted: Predicted) -> Array:
    """(P, O) radians by which each parent is uncertain where it would see each object."""
    num_parents, columns, dimension = predicted.mean.shape
    robots = np.repeat(predicted.mean[:, 0], columns - 1, axis=0)
    states = predicted.mean[:, 1:].reshape(-1, dimension)
    joint = predicted.pair_covariances().reshape(-1, 2 * dimension, 2 * dimension)
    sigma = model.sight_sigma(robots, states, joint)
    return sigma.reshape(num_parents, columns - 1)


def screen(stack: Stack, carried: Array, sigma: Array, gate: float, num_parents: int) -> Screened:
    """Drop candidates whose evidence one step from ``carried`` (B, n) puts far behind, where ``sigma`` (B,) is small.

    Of the others, the steady ones start at that step, lost ones at what explains most, the rest at ``carried``.
    """
    linear = sigma < STEADY_RAD
    energy, gradient, hessian = stack.normal_equations(carried)
    step = -np.linalg.solve(hessian, gradient[..., None])[..., 0]
    evidence = -energy - 0.5 * (gradient * step).sum(-1) - 0.5 * np.linalg.slogdet(hessian)[1]
    best = np.full(num_parents, -np.inf)
    parents = stack.rows.parents
    np.maximum.at(best, parents[linear], evidence[linear])
    behind = evidence - best[parents]
    dropped = linear & (behind < -SAFETY * gate)
    left_out = np.full(num_parents, -np.inf)
    np.logaddexp.at(left_out, parents[dropped], behind[dropped])
    kept = np.flatnonzero(~dropped)
    start, lost = carried[kept], np.flatnonzero(sigma[kept] > LOST_RAD)
    start[linear[kept]] += step[kept[linear[kept]]]
    if len(lost):
        start[lost] = _better_start(stack.select(kept[lost]), carried[kept[lost]])
    return Screened(kept, start, left_out)


def _better_start(stack: Stack, carried: Array) -> Array:
    """The mode of the detections so far, or a start that explains one detection: whichever fits better."""
    fresh = search_start(stack)
    better = stack.energy(carried) <= stack.energy(fresh)
    return np.where(better[:, None], carried, fresh)
