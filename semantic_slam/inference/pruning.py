"""Normalisation and pruning over all candidates, with an account of the discarded probability mass."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from semantic_slam.configuration import PruningConfiguration
from semantic_slam.errors import SemanticSlamError
from semantic_slam.geometry.arrays import Array

LEAST_TRUSTED = 1e-3
"""Least exponent by which weights are tempered in ``widened``; ``LARGEST_LOG_RATIO`` applies after it."""
LARGEST_LOG_RATIO = 700.0
"""Largest pruning ratio after tempering, in nats: beyond any ratio that can be configured."""


@dataclass(frozen=True, kw_only=True)
class Pruned:
    """Result of pruning: the survivors in descending order of weight."""

    kept: NDArray[np.int_]  # (S,) rows
    log_weights: Array  # (S,) normalised over the survivors
    log_mass: float  # log of the survivors' mass before normalising
    discarded: float  # d_k: share of the mass that was pruned or never enumerated


def widened(limits: PruningConfiguration, unexplained: float) -> PruningConfiguration:
    """The limits with a wider pruning ratio while the data are poorly explained, when weights are overconfident.

    ``unexplained`` 0..1 is the posterior probability of the null model. Weights are pruned as if raised to the power
    1 - ``unexplained``: the fractional posterior of a misspecified model (Bissiri, Holmes and Walker 2016). NaN: the
    limits are unchanged.
    """
    trusted = 1.0 if np.isnan(unexplained) else max(1.0 - unexplained, LEAST_TRUSTED)
    return replace(limits, ratio=float(np.exp(min(np.log(limits.ratio) / trusted, LARGEST_LOG_RATIO))))


def affordable(limits: PruningConfiguration, num_keyframes: int) -> PruningConfiguration:
    """The limits with fewer hypotheses on long runs, so that all trajectories together have ``max_poses`` at most."""
    if limits.max_poses == 0:
        return limits
    most = max(1, limits.max_poses // num_keyframes)
    return replace(limits, max_hypotheses=min(most, limits.max_hypotheses))


def most_of_a_kind(limits: PruningConfiguration, num_detections: int) -> int | None:
    """Hypotheses of a kind kept in a keyframe, so that together they have ``max_pairs`` at most; None: any number."""
    if limits.max_pairs == 0:
        return None
    return max(1, limits.max_pairs // max(1, num_detections))


@dataclass(frozen=True, kw_only=True)
class Kinds:
    """Coarse attributes of K candidates, by which they are clustered into kinds to keep the survivors diverse."""

    positions: Array  # (K, 3) of the robot, metres
    root_numbers: NDArray[np.int_]  # (K,) of each history: its noise setting and start, see `Problem.root_number`
    most: int | None = None  # kept of a kind; None: any number

    def of(self, order: NDArray[np.int_], place_m: float) -> NDArray[np.int_]:
        """(K,) cluster number of each candidate, taken in ``order``.

        A candidate joins the cluster of the first one of the same root number within ``place_m`` metres; where that is
        0, all are of one.
        """
        if place_m <= 0.0:
            return np.zeros(len(order), dtype=int)
        kinds, left = np.zeros(len(order), dtype=int), np.arange(len(order))
        positions, root_numbers, number = self.positions[order], self.root_numbers[order], 0
        while len(left):
            near = np.hypot.reduce(positions[left] - positions[left[0]], axis=1) <= place_m
            near &= root_numbers[left] == root_numbers[left[0]]
            kinds[left[near]] = number
            left, number = left[~near], number + 1
        return kinds


def prune(
    log_weights: Array,
    ids: NDArray[np.uint64],
    log_missing: Array,
    limits: PruningConfiguration,
    kinds: Kinds | None = None,
    ordinary: NDArray[np.bool_] | None = None,
) -> Pruned:
    """Keep candidates that weigh at least max / ratio, at most ``max_hypotheses`` of them; ties break by id.

    ``log_weights`` (K,) are w psi over all parents, not normalised; ``log_missing`` is the mass that was never
    enumerated, in the same units. With ``kinds`` and a positive ``place_m``, a candidate is compared to the heaviest of
    its kind by ``ratio``, and the heaviest of the kinds to each other by ``kind_ratio``; ``kinds.most`` of a kind are
    kept at most. The heaviest of the ``ordinary`` (K,) candidates stays up to ``kind_ratio`` even if no other of them
    does: what they do without is rare, and a model that is a little wrong may favour it for a while. Raises
    SemanticSlamError when no candidate has a finite weight.
    """
    if len(log_weights) == 0 or not np.isfinite(log_weights.max()):
        raise SemanticSlamError("no candidate explains the measurements; check priors, noise and visibility parameters")
    order = np.lexsort((ids, -log_weights))
    numbers = np.zeros(len(order), dtype=int) if kinds is None else kinds.of(order, limits.place_m)
    rows = _chosen(log_weights[order], numbers, None if kinds is None else kinds.most, limits)
    if ordinary is not None:
        rows = _with_ordinary(log_weights[order], rows, ordinary[order], limits)
    kept = order[rows]
    log_kept = float(np.logaddexp.reduce(log_weights[kept]))
    rest = np.concatenate([np.delete(log_weights, kept), log_missing, [-np.inf]])
    log_rest = float(np.logaddexp.reduce(rest))
    discarded = float(np.exp(log_rest - np.logaddexp(log_kept, log_rest)))
    return Pruned(kept=kept, log_weights=log_weights[kept] - log_kept, log_mass=log_kept, discarded=discarded)


def admitted(
    log_weights: Array, ids: NDArray[np.uint64], limits: PruningConfiguration, kinds: Kinds
) -> NDArray[np.int_]:
    """(A,) rows, ascending, of the candidates (K,) that the ratios of ``limits`` admit, however many these are."""
    if not len(log_weights):
        return np.zeros(0, dtype=int)
    order = np.lexsort((ids, -log_weights))
    return np.sort(order[_admitted(log_weights[order], kinds.of(order, limits.place_m), limits)])


def _admitted(log_weights: Array, kinds: NDArray[np.int_], limits: PruningConfiguration) -> NDArray[np.int_]:
    """(A,) rows within both ratios, from weights and kinds (K,) in descending order of weight."""
    heaviest = log_weights[np.unique(kinds, return_index=True)[1]]
    found = heaviest[kinds] >= log_weights[0] - _log_kind_ratio(limits)
    return np.flatnonzero(found & (log_weights >= heaviest[kinds] - np.log(limits.ratio)))


def _chosen(
    log_weights: Array, kinds: NDArray[np.int_], most: int | None, limits: PruningConfiguration
) -> NDArray[np.int_]:
    """(S,) rows that are kept, ``most`` of a kind, from weights and kinds (K,) in descending order of weight."""
    rows = _admitted(log_weights, kinds, limits)
    if most is not None:
        rows = rows[ranks(kinds[rows]) < most]
    return np.asarray(rows[shared_out(kinds[rows], limits.max_hypotheses)])


def _with_ordinary(
    log_weights: Array, rows: NDArray[np.int_], ordinary: NDArray[np.bool_], limits: PruningConfiguration
) -> NDArray[np.int_]:
    """The chosen ``rows`` with the heaviest ordinary one, unless one is chosen or it is beyond ``kind_ratio``."""
    if not ordinary.any() or ordinary[rows].any() or limits.max_hypotheses < 2:
        return rows
    heaviest = int(ordinary.argmax())
    if log_weights[heaviest] < log_weights[0] - _log_kind_ratio(limits):
        return rows
    return np.sort(np.append(rows[: limits.max_hypotheses - 1], heaviest))


def _log_kind_ratio(limits: PruningConfiguration) -> float:
    """Nats behind the heaviest candidate up to which a kind is kept."""
    return float(np.log(max(limits.kind_ratio, limits.ratio)))


def shared_out(kinds: NDArray[np.int_], limit: int) -> NDArray[np.int_]:
    """(S,) rows to keep, at most ``limit``, from ``kinds`` (K,) in descending order of weight.

    Half of the limit is filled round-robin over the kinds, the rest by weight.
    """
    rows = np.arange(len(kinds))
    if len(rows) <= limit:
        return rows
    in_turn = rows[np.argsort(ranks(kinds), kind="stable")[: limit // 2]]
    others = np.setdiff1d(rows, in_turn)
    return np.sort(np.concatenate([in_turn, others[: limit - len(in_turn)]]))


def ranks(kinds: NDArray[np.int_]) -> NDArray[np.int_]:
    """(K,) number of rows of the same kind before each one."""
    found = np.zeros(len(kinds), dtype=int)
    for kind in np.unique(kinds):
        own = kinds == kind
        found[own] = np.arange(own.sum())
    return found
