"""Normalising and pruning over all candidates, with an account of what is discarded."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from semantic_slam.configuration import PruningConfiguration
from semantic_slam.errors import SemanticSlamError
from semantic_slam.geometry.arrays import Array

LEAST_TRUSTED = 1e-3
"""Power that weights count by at least, before the next limit."""
LARGEST_LOG_RATIO = 700.0
"""Nats between hypotheses that are kept, at most: beyond any ratio that can be configured."""


@dataclass(frozen=True, kw_only=True)
class Pruned:
    """Survivors, heaviest first."""

    kept: NDArray[np.int_]  # (S,) rows
    log_weights: Array  # (S,) normalised over the survivors
    log_mass: float  # log of the survivors' mass before normalising
    discarded: float  # d_k: share of the mass that was pruned or never enumerated


def widened(limits: PruningConfiguration, unexplained: float) -> PruningConfiguration:
    """The limits where data that nothing explains have decided between hypotheses with a certainty that they lack.

    ``unexplained`` 0..1 is the probability that they say nothing; weights count by their powers 1 - ``unexplained``
    then: the fractional posterior of a model that is wrong (Bissiri, Holmes and Walker 2016). NaN: as they are.
    """
    trusted = 1.0 if np.isnan(unexplained) else max(1.0 - unexplained, LEAST_TRUSTED)
    return replace(limits, ratio=float(np.exp(min(np.log(limits.ratio) / trusted, LARGEST_LOG_RATIO))))


def prune(
    log_weights: Array,
    ids: NDArray[np.uint64],
    log_missing: Array,
    limits: PruningConfiguration,
    positions: Array | None = None,
) -> Pruned:
    """Keep what weighs at least max / ratio, at most ``max_hypotheses`` of them; ties break by id.

    ``log_weights`` (K,) are w psi over all parents, not normalised; ``log_missing`` is mass that was never
    enumerated, in the same units. ``positions`` (K, 2) of the robot [m]: half of the room then goes in turn to each
    place that the robot may be at. Raises SemanticSlamError when no candidate has any weight.
    """
    if len(log_weights) == 0 or not np.isfinite(log_weights.max()):
        raise SemanticSlamError("no candidate explains the measurements; check priors, noise and visibility parameters")
    order = np.lexsort((ids, -log_weights))
    admitted = log_weights[order] >= log_weights[order[0]] - np.log(limits.ratio)
    kept = order[admitted]
    if positions is not None and limits.place_m > 0.0 and len(kept) > limits.max_hypotheses:
        turns = _turns(positions[kept], limits.place_m)
        kept = kept[np.sort(_shared(turns, limits.max_hypotheses))]
    kept = kept[: limits.max_hypotheses]
    log_kept = float(np.logaddexp.reduce(log_weights[kept]))
    rest = np.concatenate([np.delete(log_weights, kept), log_missing, [-np.inf]])
    log_rest = float(np.logaddexp.reduce(rest))
    discarded = float(np.exp(log_rest - np.logaddexp(log_kept, log_rest)))
    return Pruned(kept=kept, log_weights=log_weights[kept] - log_kept, log_mass=log_kept, discarded=discarded)


def _turns(positions: Array, place_m: float) -> NDArray[np.int_]:
    """(S,) how many heavier ones, which come before, are at the place of each: no farther from its heaviest one."""
    turns, left = np.zeros(len(positions), dtype=int), np.arange(len(positions))
    while len(left):
        near = np.hypot(*(positions[left] - positions[left[0]]).T) <= place_m
        turns[left[near]] = np.arange(near.sum())
        left = left[~near]
    return turns


def _shared(turns: NDArray[np.int_], count: int) -> NDArray[np.int_]:
    """(count,) rows: half of them in turn for each place, then the heaviest of the others."""
    first = np.argsort(turns, kind="stable")[: count // 2]
    others = np.delete(np.arange(len(turns)), first)
    return np.concatenate([first, others[: count - len(first)]])
