"""Measurements that iSAM2 holds linear, made anew where the estimate has bent them.

All are evaluated at once, and where they are off all are made anew: linear about points that do not agree with each
other, they would tell of the heading of the whole map, which nothing measures (Huang, Mourikis, Roumeliotis,
Observability-based rules for designing consistent EKF SLAM estimators, 2010).
"""

from dataclasses import dataclass
from functools import cached_property

import gtsam
import numpy as np

from semantic_slam.geometry.arrays import squared_norms
from semantic_slam.inference.smoothing.isam import single_step_isam
from semantic_slam.inference.smoothing.linear.linear_measurements import LinearFactors, LinearMeasurements

MOST_TIMES = 15
"""Times that all is made anew after one update, at most."""
LARGEST_TURN = 0.3
"""Radians that nothing is turned by more at one time: all that is measured then changes by less than it bends."""
MOST_OFF = 0.1
"""Half the sum of squares that all measurements may be off together, in standard deviations.

No estimate is off by more than the root of twice that in those of its own.
"""
FREELY = 5
"""Times that go all the way, wherever they end: a loop that closes far away ends sooner so."""
MOST_HALVED = 4
"""Times that one way is halved, at most."""


def relinearised(isam: gtsam.ISAM2, factors: LinearFactors) -> tuple[gtsam.ISAM2, LinearFactors]:
    """An iSAM2 and its measurements after these are made anew until they stay, where they are bent.

    A loop that closes may move a long way so far that one time ends nowhere near. What has not settled after a few
    times overshoots: then a time after which all would fit worse than before goes half the way, or half of that.
    Raises RuntimeError when the system is indeterminate.
    """
    misfit = np.inf
    for time in range(MOST_TIMES):
        factors = factors.in_one_part()
        at = factors.charts.located(isam.getDelta().vector())
        if factors.off(at) <= MOST_OFF:
            break
        share = min(1.0, LARGEST_TURN / at.largest_turn) if at.largest_turn > 0.0 else 1.0
        others = _others(isam, factors)
        anew = _Anew.about(_after(isam, factors, share), others, factors)
        for _ in range(MOST_HALVED):
            if time < FREELY or anew.misfit <= misfit:
                break
            share *= 0.5
            anew = _Anew.about(_after(isam, factors, share), others, factors)
        misfit = anew.misfit
        isam, factors = anew.held()
    return isam, factors


def _after(isam: gtsam.ISAM2, factors: LinearFactors, share: float) -> gtsam.Values:
    """Where all is after a share of the way to what iSAM2 has solved for."""
    solved = isam.getDelta()
    at = factors.charts.located(share * solved.vector())
    return factors.charts.values(at, isam.getLinearizationPoint().retract(solved.scale(share)))


def _others(isam: gtsam.ISAM2, factors: LinearFactors) -> gtsam.NonlinearFactorGraph:
    """The factors that are linear anyway."""
    held, measured = isam.getFactorsUnsafe(), np.zeros(factors.num_slots, dtype=bool)
    for own in factors.joined:
        measured[own.slots] = True
    graph = gtsam.NonlinearFactorGraph()
    for slot in np.flatnonzero(~measured).tolist():
        graph.add(held.at(slot))
    return graph


@dataclass(frozen=True, kw_only=True)
class _Anew:
    """All measurements made linear about ``values``, and the factors that are linear anyway."""

    values: gtsam.Values
    others: gtsam.NonlinearFactorGraph
    empty: LinearFactors  # with charts about the values
    made: list[LinearMeasurements]

    @classmethod
    def about(cls, values: gtsam.Values, others: gtsam.NonlinearFactorGraph, factors: LinearFactors) -> "_Anew":
        """With what ``factors`` measure."""
        empty, made = factors.about(values)
        return cls(values=values, others=others, empty=empty, made=made)

    @cached_property
    def misfit(self) -> float:
        """Half the sum of the squares of all residuals at the values."""
        measured = sum(0.5 * float(squared_norms(own.constant + own.of.offset).sum()) for own in self.made)
        return measured + float(self.others.error(self.values))

    def held(self) -> tuple[gtsam.ISAM2, LinearFactors]:
        """An iSAM2 that holds them, with charts about the values."""
        graph = gtsam.NonlinearFactorGraph(self.others)
        for own in self.made:
            graph.push_back(own.factors())
        fresh = single_step_isam(self.empty.charts.spaces, errors_repeat=True)
        try:
            fresh.update(graph, self.values)
        except RuntimeError:  # too poorly conditioned for Cholesky
            fresh = single_step_isam(self.empty.charts.spaces, errors_repeat=True, factorization="QR")
            fresh.update(graph, self.values)
        return fresh, self.empty.with_new(self.made, self.others.size())
