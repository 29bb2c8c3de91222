"""The k cheapest assignments of rows to columns, in order of their cost (Murty, 1968).

The cheapest assignment partitions the others into disjoint sets: those that agree with it in the first rows and differ
in the next one. The cheapest of each set is put in a priority queue, so that every assignment comes once and in order.
"""

import heapq
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from semantic_slam.geometry.arrays import Array, Index

_Best = tuple[float, tuple[int, ...], int, Array]
"""Cheapest assignment of a set: its cost, its columns, how many leading rows are fixed, and the set's cost matrix."""


@dataclass(frozen=True)
class KBest:
    """K assignments, cheapest first."""

    columns: Index  # (K, n)
    costs: Array  # (K,)


def k_best(cost: Array, k: int, within: float = np.inf) -> KBest:
    """The ``k`` cheapest assignments that give each row of ``cost`` (n, m) a column of its own; fewer when fewer exist.

    None costs more than the cheapest one's cost plus ``within``. Infinite entries are not admitted. Equal costs come in
    an order that depends on ``cost`` alone.
    """
    in_order = _in_order(np.asarray(cost, dtype=np.float64), within)
    ranked = [item for item, _ in zip(in_order, range(k), strict=False)]
    columns = np.array([columns for _, columns in ranked], dtype=int).reshape(len(ranked), len(cost))
    return KBest(columns, np.array([total for total, _ in ranked], dtype=np.float64))


def _in_order(cost: Array, within: float) -> Iterator[tuple[float, tuple[int, ...]]]:
    """Yield assignments as (cost, columns), cheapest first, up to the cheapest one's cost plus ``within``."""
    queue: list[_Best] = []
    _push(queue, cost, cost, 0, np.inf)
    limit = queue[0][0] + within if queue else np.inf
    if np.isfinite(limit):
        queue = [(*queue[0][:3], _possible(cost, limit))]
    while queue:
        total, columns, fixed, restricted = heapq.heappop(queue)
        yield total, columns
        remaining, has_choice = restricted.copy(), np.isfinite(restricted).sum(axis=1) > 1
        for row in range(fixed, len(cost)):
            if has_choice[row]:
                branch = remaining.copy()
                branch[row, columns[row]] = np.inf
                _push(queue, cost, branch, row, limit)
            chosen = remaining[row, columns[row]]
            remaining[row], remaining[:, columns[row]] = np.inf, np.inf
            remaining[row, columns[row]] = chosen


def _possible(cost: Array, limit: float) -> Array:
    """``cost`` with entries set to inf that no assignment within ``limit`` can use, by the row minima as a bound."""
    least = cost.min(axis=1, keepdims=True)
    return np.where(cost - least <= limit - least.sum(), cost, np.inf)


def _push(queue: list[_Best], cost: Array, restricted: Array, fixed: int, limit: float) -> None:
    """Queue the cheapest assignment of ``restricted``, if there is one that costs no more than ``limit``.

    Its first ``fixed`` rows are fixed.
    """
    if len(cost) and not np.isfinite(restricted[fixed]).any():
        return
    try:
        rows, matched = linear_sum_assignment(restricted)
    except ValueError:  # infeasible
        return
    columns = tuple(matched.tolist())
    total = float(cost[rows, matched].sum())
    if len(columns) == len(cost) and total <= limit:
        heapq.heappush(queue, (total, columns, fixed, restricted))
