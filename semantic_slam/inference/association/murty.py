"""The k cheapest assignments of rows to columns, in order of their cost (Murty, 1968).

The cheapest assignment splits the rest into disjoint sets: those that agree with it in the first rows and differ in
the next one. The cheapest of each set waits in a queue, so that every assignment comes once and in order.
"""

import heapq
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from semantic_slam.geometry.arrays import Array, Index


@dataclass(frozen=True)
class KBest:
    """K assignments, cheapest first."""

    columns: Index  # (K, n)
    costs: Array  # (K,)


def k_best(cost: Array, k: int) -> KBest:
    """The ``k`` cheapest assignments that give each row of ``cost`` (n, m) a column of its own; fewer when fewer exist.

    Infinite entries are not admitted. Equal costs come in an order that depends on ``cost`` alone.
    """
    ranked = [item for item, _ in zip(_in_order(np.asarray(cost, dtype=np.float64)), range(k), strict=False)]
    columns = np.array([columns for _, columns in ranked], dtype=int).reshape(len(ranked), len(cost))
    return KBest(columns, np.array([total for total, _ in ranked], dtype=np.float64))


def _in_order(cost: Array) -> Iterator[tuple[float, tuple[int, ...]]]:
    """All assignments as (cost, columns), cheapest first."""
    queue: list[tuple[float, tuple[int, ...], int, Array]] = []
    _push(queue, cost, cost, 0)
    while queue:
        total, columns, fixed, restricted = heapq.heappop(queue)
        yield total, columns
        remaining = restricted.copy()
        for row in range(fixed, len(cost)):
            branch = remaining.copy()
            branch[row, columns[row]] = np.inf
            _push(queue, cost, branch, row)
            chosen = remaining[row, columns[row]]
            remaining[row], remaining[:, columns[row]] = np.inf, np.inf
            remaining[row, columns[row]] = chosen


def _push(queue: list[tuple[float, tuple[int, ...], int, Array]], cost: Array, restricted: Array, fixed: int) -> None:
    """Queue the cheapest assignment of ``restricted``, if there is one; its first ``fixed`` rows have no choice."""
    try:
        rows, matched = linear_sum_assignment(restricted)
    except ValueError:  # infeasible
        return
    columns = tuple(int(column) for column in matched)
    if len(columns) < len(cost):
        return
    heapq.heappush(queue, (float(cost[rows, matched].sum()), columns, fixed, restricted))
