"""Factors that iSAM2 holds linearised, made anew where robots and landmarks have moved.

iSAM2 would hand a copy of all of its values to every callback into Python, and most factors are such callbacks where
errors of detections repeat. It is given them linearised; here are the factors themselves, in the slots that they have
there. When a state moves far, iSAM2 is told to relinearise it, and its factors are made anew at the estimate: as iSAM2
does by itself with factors of its own.
"""

from collections.abc import Sequence
from typing import NamedTuple

import gtsam
import numpy as np

from semantic_slam.inference.models.linear_factors import linearised
from semantic_slam.inference.smoothing.isam import single_step_isam
from semantic_slam.inference.states.keys import is_object, is_robot
from semantic_slam.inference.states.spaces import Spaces

MOST_TIMES = 5
"""Times that what moves is linearised anew after one update, at most."""
NEAR = 1.5
"""Thresholds that a state may be off after that without another time: the next one is soon enough for it."""
MOST_MOVED = 0.5
"""Share of the factors that are on what moved from which on all are made anew, in an order that suits all."""
MOST_SLOTS = 4
"""Slots for factors to each factor from which on they are, too: iSAM2 fills none again."""


class Moved(NamedTuple):
    """What is not near where iSAM2 has it linearised."""

    keys: list[int]
    farthest: float  # in thresholds, of all that there is


def relinearised(
    isam: gtsam.ISAM2, exact: gtsam.NonlinearFactorGraph, spaces: Spaces
) -> tuple[gtsam.ISAM2, gtsam.NonlinearFactorGraph]:
    """An iSAM2 and its ``exact`` factors, slot by slot, after what has moved is linearised anew until it stays.

    A loop that closes may move a long way so far that one time ends nowhere near. ``isam`` may be changed.
    """
    for times in range(MOST_TIMES):
        moved = moved_far(isam, spaces)
        if moved.farthest <= (NEAR if times else 1.0):
            break
        isam, exact = _with_factors_anew(isam, exact, spaces, moved.keys)
    return isam, exact


def moved_far(isam: gtsam.ISAM2, spaces: Spaces) -> Moved:
    """The robots and landmarks, last by their keys, that iSAM2 relinearises when it is told to."""
    keys, layout = isam.getLinearizationPoint().keys(), spaces.layout
    robots, objects = (sum(is_kind(key) for key in keys) for is_kind in (is_robot, is_object))
    changes = np.abs(isam.getDelta().vector())
    split = len(changes) - robots * layout.robot
    begin = split - objects * layout.landmark
    limits = spaces.landmark.relinearize_threshold, spaces.robot.relinearize_threshold
    parts = changes[begin:split].reshape(objects, layout.landmark), changes[split:].reshape(robots, layout.robot)
    far = np.concatenate([(part / limit).max(axis=1) for part, limit in zip(parts, limits, strict=True)])
    near = np.concatenate([(part <= limit).all(axis=1) for part, limit in zip(parts, limits, strict=True)])
    return Moved([keys[place] for place in len(keys) - len(near) + np.flatnonzero(~near)], float(far.max(initial=0.0)))


def _with_factors_anew(
    isam: gtsam.ISAM2, exact: gtsam.NonlinearFactorGraph, spaces: Spaces, moved: Sequence[int]
) -> tuple[gtsam.ISAM2, gtsam.NonlinearFactorGraph]:
    """What has ``moved`` linearised anew, and the factors on it made anew: all, where those are most of them."""
    index, count, factors = isam.getVariableIndex(), exact.nrFactors(), gtsam.NonlinearFactorGraph()
    slots = sorted({slot for key in moved for slot in index.at(key)})
    if len(slots) > MOST_MOVED * count or exact.size() > MOST_SLOTS * count:
        for slot in range(exact.size()):
            if exact.exists(slot):
                factors.add(exact.at(slot))
        estimate, fresh = isam.calculateEstimate(), single_step_isam(spaces, errors_repeat=True)
        fresh.update(linearised(factors, estimate), estimate)
        return fresh, factors
    for slot in slots:
        factors.add(exact.at(slot))
    kept = gtsam.NonlinearFactorGraph(exact)
    kept.push_back(factors)
    for slot in slots:
        kept.remove(slot)
    point = isam.calculateEstimate(factors.keyVector())
    isam.update(linearised(factors, point), gtsam.Values(), slots, force_relinearize=True)
    return isam, kept
