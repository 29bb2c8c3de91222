"""The k cheapest assignments of rows to columns, in order of their cost (Murty, 1968).

Rows that may take a common column are linked; the connected components (clusters) are independent, so that the cheapest
assignments are sums of those of clusters. Within a cluster, the cheapest assignment partitions the others into disjoint
sets: those that agree with it in the first rows and differ in the next one. The cheapest of each set is put in a
priority queue, so that every assignment comes once and in order.
"""

import heapq
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.association.sums import clusters

_Best = tuple[float, tuple[int, ...], int, Array]
"""Cheapest assignment of a set: its cost and columns, how many leading rows are fixed, and the costs of the others."""


LARGE, WIDTHS = 12, (0.05, 0.1, 0.2, 0.5, 1.0)
"""Rows beyond which the cheapest assignments are sought in growing shares of the bound: clusters are smaller there."""


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
    cost = np.asarray(cost, dtype=np.float64)
    found = KBest(np.zeros((0, len(cost)), dtype=int), np.zeros(0))
    for width in within * np.array(WIDTHS if len(cost) > LARGE and np.isfinite(within) else [1.0]):
        found = _up_to(cost, k, float(width))
        if len(found.costs) == k:
            break
    return found


def _up_to(cost: Array, k: int, within: float) -> KBest:
    """The ``k`` cheapest up to the cheapest one's cost plus ``within``, cluster by cluster."""
    possible = _possible(cost, within)
    if possible is None:
        return KBest(np.zeros((0, len(cost)), dtype=int), np.zeros(0))
    columns, totals = np.full((1, len(cost)), -1), np.zeros(1)
    for rows, of_rows in clusters(np.isfinite(possible)):
        own = _of_cluster(possible[rows[:, None], of_rows], k, within)
        first, second, totals = _cheapest_sums(totals, own.costs, k, within)
        columns = columns[first]
        columns[:, rows] = of_rows[own.columns[second]]
    totals = cost[np.arange(len(cost)), columns].sum(axis=1)
    order = np.lexsort((*columns.T[::-1], totals))
    order = order[totals[order] <= totals[order[0]] + within]
    return KBest(columns[order], totals[order])


def _cheapest_sums(first: Array, second: Array, k: int, within: float) -> tuple[Index, Index, Array]:
    """Places in two ascending lists of the ``k`` pairs with the least sums, up to the least plus ``within``; the sums.

    A pair is behind all pairs of places before its own, so that (i, j) is among the k least only if i j < k.
    """
    counts = np.minimum(k // np.arange(1, 1 + len(first)), len(second))  # of second places beside each first one
    i = np.repeat(np.arange(len(first)), counts)
    j = np.arange(len(i)) - np.repeat(np.cumsum(counts) - counts, counts)
    sums = first[i] + second[j]
    order = np.argsort(sums, kind="stable")[:k]
    order = order[sums[order] <= sums[order[0]] + within]
    return i[order], j[order], sums[order]


def _of_cluster(cost: Array, k: int, within: float) -> KBest:
    """The ``k`` cheapest assignments of one cluster."""
    if len(cost) == 1:
        return _of_row(cost[0], k, within)
    ranked = [item for item, _ in zip(_in_order(cost, within), range(k), strict=False)]
    columns = np.array([columns for _, columns in ranked], dtype=int).reshape(len(ranked), len(cost))
    return KBest(columns, np.array([total for total, _ in ranked], dtype=np.float64))


def _of_row(cost: Array, k: int, within: float) -> KBest:
    """The ``k`` cheapest columns of a single row (m,)."""
    columns = np.argsort(cost, kind="stable")[:k]
    columns = columns[cost[columns] <= cost[columns[0]] + within]
    return KBest(columns[:, None], cost[columns])


def _in_order(cost: Array, within: float) -> Iterator[tuple[float, tuple[int, ...]]]:
    """Yield assignments as (cost, columns), cheapest first, up to the cheapest one's cost plus ``within``."""
    queue: list[_Best] = []
    _push(queue, cost, cost.copy(), (), np.inf)
    limit = queue[0][0] + within if queue else np.inf
    while queue:
        total, columns, fixed, remaining = heapq.heappop(queue)
        yield total, columns
        has_choice = np.isfinite(remaining).sum(axis=1) > 1
        for row in range(fixed, len(cost)):
            if has_choice[row - fixed]:
                branch = remaining[row - fixed :].copy()
                branch[0, columns[row]] = np.inf
                _push(queue, cost, branch, columns[:row], limit)
            remaining[row - fixed + 1 :, columns[row]] = np.inf


def _possible(cost: Array, within: float) -> Array | None:
    """``cost`` without entries that no assignment near the cheapest can use; None where nothing can be assigned.

    An entry is impossible (inf) if it costs more, with the least costs of all other rows, than the cheapest assignment
    plus ``within``.
    """
    if len(cost) > cost.shape[1]:
        return None
    try:
        rows, columns = linear_sum_assignment(cost)
    except ValueError:  # infeasible
        return None
    limit, least = float(cost[rows, columns].sum()) + within, cost.min(axis=1, keepdims=True)
    return np.where(cost - least <= limit - least.sum(), cost, np.inf)


def _push(queue: list[_Best], cost: Array, branch: Array, fixed: tuple[int, ...], limit: float) -> None:
    """Queue the cheapest assignment of a set, if there is one that costs no more than ``limit``.

    ``fixed`` are the columns of its first rows, and ``branch`` the costs of the other rows, inf in these columns.
    """
    try:
        _, matched = linear_sum_assignment(branch)
    except ValueError:  # infeasible
        return
    columns = (*fixed, *matched.tolist())
    if len(columns) < len(cost):
        return
    total = float(cost[np.arange(len(cost)), columns].sum())
    if total <= limit:
        heapq.heappush(queue, (total, columns, len(fixed), branch))
