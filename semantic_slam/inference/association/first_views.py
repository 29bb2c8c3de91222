"""First views of objects whose class is open: a class stands for what it makes of the view, "open" for an outlier.

The likelihood of a view under a class, (1 - e) p + e p_out, holds both. Summed over all classes the second part
would be as many candidates that say the same; it is one instead, whose class stays open, and is taken off the others.
"""

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.association.enumeration import EnumerationProblem, is_new, log_of_inlier
from semantic_slam.inference.evidence.candidates import Candidates


def log_first_inliers(setting: EnumerationProblem, candidates: Candidates, log_outlier: Array) -> Array:
    """(K,) log of the share of each candidate's evidence in which the first views of its objects are no outliers.

    ``log_outlier`` (D,): log density of each view as an outlier, its share included. The share is that at the mode.
    """
    stack, mode = candidates.solved()
    states, classes = stack.states(mode.y), stack.rows.classes
    assert classes is not None
    total, every = np.zeros(len(states)), np.arange(len(states))
    for number, log_floor in enumerate(log_outlier.tolist()):
        new = is_new(setting, stack, every, classes[:, :number], number) & (classes[:, number] >= 0)
        rows = np.flatnonzero(new)
        if not len(rows):
            continue
        x, o = stack.robots_of(states)[rows], stack.objects_of(states, number)[rows]
        detection = stack.detections.take([number])
        logs = [setting.model.log_likelihood(detection, x, o, own) for own in (classes[rows, number], None)]
        log_mixed = logs[0] - logs[1]
        total[rows] += log_of_inlier(log_mixed, log_floor) - log_mixed
    return total
