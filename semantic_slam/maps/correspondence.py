"""Object correspondence of two maps: sums over the most likely assignments (Murty), and alignment refinement."""

from dataclasses import dataclass, replace

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.association.murty import KBest, k_best
from semantic_slam.maps.landmarks import Landmarks
from semantic_slam.maps.likelihood import Alignment, Pairs, pairs

MOST_ASSIGNMENTS, REFINEMENTS = 200, 8
NEVER = 80.0
"""Gap [nats] to the best pair beyond which a pair is not considered."""


@dataclass(frozen=True, kw_only=True)
class Correspondence:
    """Correspondence probabilities under one alignment; n old and m new objects."""

    alignment: Alignment
    pairs: Pairs
    same: Array  # (n, m) probabilities: same object, not moved
    displaced: Array  # (n, m)

    @property
    def vacated(self) -> Array:
        """(n,) probabilities that old objects are no longer at their place."""
        return np.asarray(np.clip(1.0 - self.same.sum(axis=1), 0.0, 1.0))


def corresponding(
    old: Landmarks, new: Landmarks, log_absent: Array, start: Alignment, prior: Array, *, is_continued: bool = False
) -> Correspondence:
    """Correspondence from a start alignment, refined by its matches; ``log_absent`` (n,): log weight of no match.

    ``prior`` (F, F): information matrix of the deviation from the start alignment; 0 where nothing is known.
    """
    found = _assigned(old, new, log_absent, start, np.ones(len(old)), is_continued)
    for _ in range(REFINEMENTS):
        refined = _refined(new, found, start, prior) or found.alignment
        found = _assigned(old, new, log_absent, refined, found.vacated, is_continued)
    return found


def likeliest(log_pairs: Array, log_absent: Array) -> KBest:
    """Likeliest assignments, by log weights (n, m) of pairs; columns from m on are old objects without counterpart."""
    count, size = log_pairs.shape
    cost = np.full((count, size + count), np.inf)
    cost[:, :size] = np.where(log_pairs > log_absent[:, None] - NEVER, -log_pairs, np.inf)
    cost[np.arange(count), size + np.arange(count)] = -log_absent
    return k_best(cost, MOST_ASSIGNMENTS)


def _assigned(
    old: Landmarks, new: Landmarks, log_absent: Array, alignment: Alignment, vacated: Array, is_continued: bool
) -> Correspondence:
    likelihoods = pairs(old, new, alignment, vacated, is_continued=is_continued)
    both = np.logaddexp(likelihoods.log_same, likelihoods.log_displaced)
    best, count = likeliest(both, log_absent), len(old)
    log_sum = float(np.logaddexp.reduce(-best.costs))
    weights = np.exp(-best.costs - log_sum)
    matched = np.zeros((count, len(new) + count))
    for columns, weight in zip(best.columns, weights, strict=True):
        matched[np.arange(count), columns] += weight
    matched = matched[:, : len(new)]
    return Correspondence(
        alignment=alignment,
        pairs=likelihoods,
        same=matched * np.exp(likelihoods.log_same - both),
        displaced=matched * np.exp(likelihoods.log_displaced - both),
    )


def _refined(new: Landmarks, found: Correspondence, start: Alignment, prior: Array) -> Alignment | None:
    """Least-squares alignment from probability-weighted matches; None where there are too few."""
    rows, columns = np.nonzero(found.same > 0.05)
    now, frames = found.alignment, new.frames
    slopes = frames.slopes(frames.moved(now.T_old_new, new.states), now.centre)
    back = frames.compose(start.T_old_new, frames.inverse(now.T_old_new))
    information, right = prior.copy(), prior @ frames.error_about(now.centre, back)
    for row, column in zip(rows, columns, strict=True):
        own, slope = found.pairs.covariance[row, column], slopes[column]
        own = own - slope @ now.covariance @ slope.T
        weight = found.same[row, column] * np.linalg.inv(own)
        if frames.coordinates.has_yaw and own[2, 2] > 1.0:  # object without a heading
            weight[2], weight[:, 2] = 0.0, 0.0
        information = information + slope.T @ weight @ slope
        right = right - slope.T @ weight @ found.pairs.offset[row, column]
    values = np.linalg.eigvalsh(information)
    if values[0] <= 1e-6:
        return None
    step = np.linalg.solve(information, right)
    T = frames.compose(frames.about(now.centre, np.asarray(step)), now.T_old_new)
    return replace(now, T_old_new=T, covariance=np.asarray(np.linalg.inv(information)))
