"""Relinearisation of measurements that iSAM2 holds linear, where the estimate has left their linear range.

All are evaluated in one batch, and where the error is too large all are relinearised: with inconsistent linearisation
points they would give spurious information on the heading of the whole map, which nothing measures (Huang, Mourikis,
Roumeliotis, Observability-based rules for designing consistent EKF SLAM estimators, 2010).
"""

from dataclasses import dataclass
from functools import cached_property

import gtsam
import numpy as np

from semantic_slam.geometry.arrays import squared_norms
from semantic_slam.inference.smoothing.linear.linear_measurements import LinearFactors, LinearMeasurements
from semantic_slam.inference.smoothing.solver.isam import single_step_isam

MOST_TIMES = 15
"""Most relinearisations after one update."""
LARGEST_TURN = 0.3
"""Largest rotation [rad] of a robot in one relinearisation step; longer steps are scaled down, to stay in the range in
which measurements are nearly linear."""
MOST_OFF = 0.1
"""Largest half sum of squared linearisation errors of all measurements together, in standard deviations.  No estimate
is then off by more than the root of twice that, in its own standard deviations."""
FREELY = 5
"""Number of first iterations that take full steps, wherever they end: a loop closure far away converges sooner so."""
MOST_HALVED = 4
"""Most halvings of one step."""


def relinearised(isam: gtsam.ISAM2, factors: LinearFactors) -> tuple[gtsam.ISAM2, LinearFactors]:
    """An iSAM2 and its measurements, relinearised until the linearisation error is small.

    A loop closure may move the estimate so far that one iteration does not get near. Iterations that have not converged
    after a few overshoot: from then on a step after which the total error would be larger than before is halved,
    repeatedly. Raises RuntimeError when the system is indeterminate.
    """
    factors, factorization = factors.in_one_part(), isam.params().getFactorization()
    before: _Anew | None = None
    for time in range(MOST_TIMES):
        at = factors.charts.located(isam.getDelta().vector())
        if factors.off(at) <= MOST_OFF:
            break
        share = min(1.0, LARGEST_TURN / at.largest_turn) if at.largest_turn > 0.0 else 1.0
        others = _others(isam, factors) if before is None else before.others
        anew = _Anew.about(_after(isam, factors, share), others, factors)
        for _ in range(MOST_HALVED):
            if before is None or time < FREELY or anew.misfit <= before.misfit:
                break
            share *= 0.5
            anew = _Anew.about(_after(isam, factors, share), others, factors)
        before = anew
        isam, factors = anew.held(factorization)
    return isam, factors


def _after(isam: gtsam.ISAM2, factors: LinearFactors, share: float) -> gtsam.Values:
    """Values after a share of the step that iSAM2 has solved for."""
    solved = isam.getDelta()
    at = factors.charts.located(share * solved.vector())
    return factors.charts.values(at, isam.getLinearizationPoint().retract(solved.scale(share)))


def _others(isam: gtsam.ISAM2, factors: LinearFactors) -> gtsam.NonlinearFactorGraph:
    """The factors that are linear in any case."""
    held, measured = isam.getFactorsUnsafe(), np.zeros(factors.num_slots, dtype=bool)
    for own in factors.joined:
        measured[own.slots] = True
    graph = gtsam.NonlinearFactorGraph()
    for slot in np.flatnonzero(~measured).tolist():
        graph.add(held.at(slot))
    return graph


@dataclass(frozen=True, kw_only=True)
class _Anew:
    """All measurements linearised about ``values``, and the factors that are linear in any case."""

    values: gtsam.Values
    others: gtsam.NonlinearFactorGraph
    empty: LinearFactors  # with charts about the values
    made: list[LinearMeasurements]

    @classmethod
    def about(cls, values: gtsam.Values, others: gtsam.NonlinearFactorGraph, factors: LinearFactors) -> "_Anew":
        """The measurements of ``factors``, linearised about ``values``."""
        empty, made = factors.about(values)
        return cls(values=values, others=others, empty=empty, made=made)

    @cached_property
    def misfit(self) -> float:
        """Half the sum of squared residuals at the values."""
        measured = sum(0.5 * float(squared_norms(own.constant + own.of.offset).sum()) for own in self.made)
        return measured + float(self.others.error(self.values))

    def held(self, factorization: str) -> tuple[gtsam.ISAM2, LinearFactors]:
        """An iSAM2 that holds the relinearised factors, with charts about the values."""
        graph = gtsam.NonlinearFactorGraph(self.others)
        for own in self.made:
            graph.push_back(own.factors())
        fresh = single_step_isam(self.empty.charts.spaces, errors_repeat=True, factorization=factorization)
        try:
            fresh.update(graph, self.values)
        except RuntimeError:  # too poorly conditioned for Cholesky
            fresh = single_step_isam(self.empty.charts.spaces, errors_repeat=True, factorization="QR")
            fresh.update(graph, self.values)
        return fresh, self.empty.with_new(self.made, self.others.size())
