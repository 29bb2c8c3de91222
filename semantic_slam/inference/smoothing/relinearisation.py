"""Measurements that iSAM2 holds linear, made anew where the estimate has bent them.

All are evaluated at once, and where they are off all are made anew: linear about points that do not agree with each
other, they would tell of the heading of the whole map, which nothing measures (Huang, Mourikis, Roumeliotis,
Observability-based rules for designing consistent EKF SLAM estimators, 2010).
"""

import gtsam
import numpy as np

from semantic_slam.inference.smoothing.isam import single_step_isam
from semantic_slam.inference.smoothing.linear.linear_measurements import LinearFactors

MOST_TIMES = 15
"""Times that all is made anew after one update, at most."""
LARGEST_TURN = 0.3
"""Radians that nothing is turned by more at one time: all that is measured then changes by less than it bends."""
MOST_OFF = 0.1
"""Half the sum of squares that all measurements may be off together, in standard deviations.

No estimate is off by more than the root of twice that in those of its own.
"""


def relinearised(isam: gtsam.ISAM2, factors: LinearFactors) -> tuple[gtsam.ISAM2, LinearFactors]:
    """An iSAM2 and its measurements after these are made anew until they stay, where they are bent.

    A loop that closes may move a long way so far that one time ends nowhere near.
    """
    for _ in range(MOST_TIMES):
        factors = factors.in_one_part()
        steps = isam.getDelta().vector()
        at = factors.charts.located(steps)
        if factors.off(at) <= MOST_OFF:
            break
        if at.largest_turn > LARGEST_TURN:
            at = factors.charts.located(LARGEST_TURN / at.largest_turn * steps)
        isam, factors = _afresh(isam, factors, factors.charts.values(at, isam.calculateEstimate()))
    return isam, factors


def _afresh(isam: gtsam.ISAM2, factors: LinearFactors, values: gtsam.Values) -> tuple[gtsam.ISAM2, LinearFactors]:
    """Another iSAM2, with charts about ``values``, of all measurements and of the factors that are linear anyway."""
    held, measured = isam.getFactorsUnsafe(), np.zeros(factors.num_slots, dtype=bool)
    for own in factors.joined:
        measured[own.slots] = True
    graph = gtsam.NonlinearFactorGraph()
    for slot in np.flatnonzero(~measured).tolist():
        graph.add(held.at(slot))
    others = graph.size()
    empty, made = factors.about(values)
    for own in made:
        graph.push_back(own.factors())
    fresh = single_step_isam(factors.charts.spaces, errors_repeat=True)
    fresh.update(graph, values)
    return fresh, empty.with_new(made, others)
