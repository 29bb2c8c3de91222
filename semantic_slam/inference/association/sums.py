"""Exact sums over all joint assignments of detections to distinct objects (as in JPDA), cluster by cluster.

Detections that may be of a common object are linked; clusters are the connected components. Clusters are independent,
so that the sum over all assignments is the product over clusters. The weight of an assignment is the product over its
pairs.
"""

from collections.abc import Iterator

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index

LARGEST_SET = 12
"""Largest cluster, in detections, whose sum is exact: it runs over all subsets of its detections."""
NEGLIGIBLE = 1e-12
"""Pairs of a smaller weight, relative to a detection's best, are neglected."""


def log_sum_of_all(log_known: Array, log_new: Array) -> float:
    """Log of the sum over all assignments of D detections to distinct objects out of M, or to none.

    ``log_known`` (D, M), ``log_new`` (D,). An upper bound, in which objects may be taken twice, where a cluster has
    more than :data:`LARGEST_SET` detections.
    """
    known, new, scale = _scaled(log_known, log_new)
    each = (_sum(known[rows[:, None], columns], new[rows]) for rows, columns in clusters(known))
    return float(scale.sum() + sum(np.log(own) for own in each))


def clusters(known: Array) -> Iterator[tuple[Index, Index]]:
    """Yield rows (detections) and columns (objects) of each cluster of weights ``known`` (D, M), ordered by row."""
    if not len(known):
        return
    may_be, rows = known > NEGLIGIBLE, np.arange(len(known))
    together = _connected(may_be.astype(float) @ may_be.T > 0.0)
    for members in together[together.argmax(axis=1) == rows]:  # those of each cluster's first row
        yield rows[members], np.flatnonzero(may_be[members].any(axis=0))


def _connected(linked: Flags) -> Flags:
    """(D, D) which rows are in one connected component of the symmetric adjacency matrix ``linked`` (D, D)."""
    reached = linked | np.eye(len(linked), dtype=bool)
    while True:
        steps = reached.astype(float)
        further = steps @ steps > 0.0  # along paths twice as long
        if (further == reached).all():
            return reached
        reached = further


def _scaled(log_known: Array, log_new: Array) -> tuple[Array, Array, Array]:
    """Weights (D, M) and (D,) relative to the best of each detection, and (D,) the logs of the best."""
    scale = np.maximum(log_new, log_known.max(axis=1, initial=-np.inf))
    return np.exp(log_known - scale[:, None]), np.exp(log_new - scale), scale


def _sum(known: Array, new: Array) -> float:
    """The sum over all assignments of one cluster.

    Dynamic programming over objects: each takes no detection or one of those left; the state is the set of detections
    that are taken, 2^D terms.
    """
    count = len(new)
    if count == 1 or count > LARGEST_SET:
        return float((known.sum(axis=1) + new).prod())
    taken = np.zeros(2**count)
    taken[0] = 1.0
    for weights in known.T:
        before = taken.copy()
        for number, weight in enumerate(weights.tolist()):
            if weight > NEGLIGIBLE:
                halves = (-1, 2, 2**number)  # the middle axis says whether that detection is taken
                taken.reshape(halves)[:, 1] += weight * before.reshape(halves)[:, 0]
    for weight in new:  # detections that are not taken are of no known object
        taken = taken[0::2] * weight + taken[1::2]
    return float(taken[0])
