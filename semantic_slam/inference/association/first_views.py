"""First views of objects of unknown class: candidates per class for inliers, and one with open class for outliers.

The likelihood of a view under a class is (1 - e) p + e p_out. The outlier term is the same for all classes, so that
keeping it in each would make equivalent candidates. It is one candidate of its own instead, whose class stays open, and
is subtracted from the others.
"""

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.association.enumeration import EnumerationProblem, is_new, log_of_inlier
from semantic_slam.inference.evidence.weighed_associations import WeighedAssociations


def log_first_inliers(setting: EnumerationProblem, candidates: WeighedAssociations, log_outlier: Array) -> Array:
    """(K,) log fraction of each candidate's evidence in which first views of its objects are inliers, at the mode.

    ``log_outlier`` (D,): log density of each view as an outlier, e p_out, its probability e included.
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
