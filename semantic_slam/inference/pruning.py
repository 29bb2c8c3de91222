"""Normalising and pruning over all candidates, with an account of what is discarded."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semantic_slam.configuration import PruningConfiguration
from semantic_slam.errors import SemanticSlamError
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import planar_from_pose_vector, wrap_angle

ALIKE_M, ALIKE_RAD = 0.5, 0.25
"""Robots nearer to each other than this stand together."""


@dataclass(frozen=True, kw_only=True)
class Pruned:
    """Survivors, heaviest first."""

    kept: NDArray[np.int_]  # (S,) rows
    log_weights: Array  # (S,) normalised over the survivors
    log_mass: float  # log of the survivors' mass before normalising
    discarded: float  # d_k: share of the mass that was pruned or never enumerated


def prune(
    log_weights: Array, ids: NDArray[np.uint64], poses: Array, log_missing: Array, limits: PruningConfiguration
) -> Pruned:
    """Keep what weighs at least max / ratio, at most ``max_hypotheses`` of them; ties break by id.

    ``log_weights`` (K,) are w psi over all parents, not normalised; ``poses`` (K, 7) of their robots; ``log_missing``
    is mass that was never enumerated, in the same units. Raises SemanticSlamError when no candidate has any weight.
    """
    if len(log_weights) == 0 or not np.isfinite(log_weights.max()):
        raise SemanticSlamError("no candidate explains the measurements; check priors, noise and visibility parameters")
    order = np.lexsort((ids, -log_weights))
    admitted = log_weights[order] >= log_weights[order[0]] - np.log(limits.ratio)
    kept = _chosen(order[admitted], planar_from_pose_vector(poses), limits)
    log_kept = float(np.logaddexp.reduce(log_weights[kept]))
    rest = np.concatenate([np.delete(log_weights, kept), log_missing, [-np.inf]])
    log_rest = float(np.logaddexp.reduce(rest))
    discarded = float(np.exp(log_rest - np.logaddexp(log_kept, log_rest)))
    return Pruned(kept=kept, log_weights=log_weights[kept] - log_kept, log_mass=log_kept, discarded=discarded)


def _chosen(order: NDArray[np.int_], places: Array, limits: PruningConfiguration) -> NDArray[np.int_]:
    """At most ``max_hypotheses`` of ``order``, heaviest first; ``places`` (K, 3) of their robots.

    Where there are more, what differs in local questions alone, their robots standing together, takes ``max_alike`` of
    them at most, as long as any other waits: what is undecided at large must outlive what is undecided here.
    """
    if len(order) <= limits.max_hypotheses or limits.max_alike == 0:
        return order[: limits.max_hypotheses]
    leaders, members = np.zeros((0, 3)), np.zeros(0, dtype=int)
    apart = np.zeros(len(order), dtype=bool)
    for at, row in enumerate(order):
        offset = leaders - places[row]
        near = (np.hypot(offset[:, 0], offset[:, 1]) <= ALIKE_M) & (np.abs(wrap_angle(offset[:, 2])) <= ALIKE_RAD)
        if not near.any():
            leaders, members = np.concatenate([leaders, places[row][None]]), np.append(members, 0)
            near = np.append(near, True)
        leader = int(np.argmax(near))
        apart[at] = members[leader] < limits.max_alike
        members[leader] += 1
    preferred = np.concatenate([np.flatnonzero(apart), np.flatnonzero(~apart)])[: limits.max_hypotheses]
    return np.asarray(order[np.sort(preferred)])
