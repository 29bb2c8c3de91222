"""Measurements that iSAM2 holds linear, made anew where the estimate has bent them.

iSAM2 would evaluate them one by one, through callbacks into Python where errors of detections repeat, and all of those
on what has moved: a map that only moves or turns as a whole by a little bends none. All are evaluated here at once, and
those that are off are replaced in the charts that iSAM2 has, which it never changes.
"""

from collections.abc import Sequence
from dataclasses import replace

import gtsam
import numpy as np

from semantic_slam.geometry.arrays import Array, Flags
from semantic_slam.inference.smoothing.isam import single_step_isam
from semantic_slam.inference.smoothing.linear_measurements import LinearFactors, LinearMeasurements

MOST_TIMES = 10
"""Times that what is bent is made anew after one update, at most."""
MOST_OFF, LEAST_OFF = 0.1, 0.01
"""Half the sum of squares that all measurements may be off together, and may stay off when they are made anew.

In standard deviations: no estimate is off by more than the root of twice that in those of its own.
"""
MOST_BENT = 0.5
"""Share of the measurements that are bent from which on all are made anew, in an order that suits all."""
MOST_SLOTS = 4
"""Slots for factors to each measurement from which on they are, too: iSAM2 fills none again."""


def relinearised(isam: gtsam.ISAM2, factors: LinearFactors) -> tuple[gtsam.ISAM2, LinearFactors]:
    """An iSAM2 and its measurements after those that are bent are made anew until they stay; ``isam`` may be changed.

    A loop that closes may move a long way so far that one time ends nowhere near.
    """
    for _ in range(MOST_TIMES):
        factors = factors.in_one_part()
        kinds, at = factors.joined, factors.charts.located(isam.getDelta().vector())
        slopes = [own.of.measured(factors.charts.spaces, factors.model, at) for own in kinds]
        bent = _bent([own.off(here) for own, here in zip(kinds, slopes, strict=True)])
        total = sum(int(rows.sum()) for rows in bent)
        if not total:
            return isam, factors
        if total > MOST_BENT * factors.count or factors.num_slots > MOST_SLOTS * factors.count:
            isam, factors = _afresh(isam, factors, factors.charts.values(at, isam.calculateEstimate()))
        else:
            anew = [LinearMeasurements.made(own.of, here) for own, here in zip(kinds, slopes, strict=True)]
            isam, factors = _replaced(isam, factors, kinds, anew, bent)
    return isam, factors


def _bent(off: Sequence[Array]) -> list[Flags]:
    """Of each kind, which measurements are to be made anew, from halves of the squares that they are off."""
    every = np.concatenate([np.zeros(0), *off])
    if every.sum() <= MOST_OFF:
        return [np.zeros(len(own), dtype=bool) for own in off]
    ascending = np.sort(every)
    limit = ascending[np.searchsorted(np.cumsum(ascending), LEAST_OFF)]
    return [own >= limit for own in off]


def _replaced(
    isam: gtsam.ISAM2,
    factors: LinearFactors,
    kinds: Sequence[LinearMeasurements],
    anew: Sequence[LinearMeasurements],
    bent: Sequence[Flags],
) -> tuple[gtsam.ISAM2, LinearFactors]:
    """The ``bent`` ones of measurements of some kinds replaced by those made ``anew``."""
    graph, removed, chosen = gtsam.NonlinearFactorGraph(), [], []
    kept: tuple[list[LinearMeasurements], list[LinearMeasurements]] = ([], [])
    for own, other, rows in zip(kinds, anew, bent, strict=True):
        kept[own.kind].append(own.take(~rows))
        chosen.append(other.take(rows))
        removed += own.slots[rows].tolist()
        for factor in chosen[-1].factors():
            graph.add(factor)
    isam.update(graph, gtsam.Values(), removed)
    return isam, replace(factors, parts=tuple(tuple(own) for own in kept)).with_new(chosen, 0)


def _afresh(isam: gtsam.ISAM2, factors: LinearFactors, values: gtsam.Values) -> tuple[gtsam.ISAM2, LinearFactors]:
    """Another iSAM2, with charts about ``values``, of all measurements and of the factors that are linear anyway."""
    held, measured = isam.getFactorsUnsafe(), np.zeros(factors.num_slots, dtype=bool)
    for own in factors.joined:
        measured[own.slots] = True
    graph = gtsam.NonlinearFactorGraph()
    for slot in np.flatnonzero(~measured).tolist():
        if held.exists(slot):
            graph.add(held.at(slot))
    others = graph.size()
    empty, made = factors.about(values)
    for own in made:
        for factor in own.factors():
            graph.add(factor)
    fresh = single_step_isam(factors.charts.spaces, errors_repeat=True)
    fresh.update(graph, values)
    return fresh, empty.with_new(made, others)
