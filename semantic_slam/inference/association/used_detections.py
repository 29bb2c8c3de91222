"""Which detections of a keyframe are associated with the objects of a known map; the others are clutter throughout."""

import numpy as np

from semantic_slam.geometry.arrays import Index
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.world.problem import Problem

SPARE, MOST_USED = 8, 32
"""With clutter: detections beyond the number of objects that are associated in a keyframe, and most of all."""


def used_detections(problem: Problem, step: Step) -> Index:
    """(n,) ascending indices of the best-scored detections of ``step``, as many as there are objects.

    An object and its displaced twin count once, as they exclude each other. Where detections need not be of different
    objects it is all of them; with clutter some more than there are objects.
    """
    num_objects = len(problem.objects) - len(problem.displaced.elsewhere)
    limit = num_objects if problem.distinct else (len(step.names) if num_objects else 0)
    if problem.clutter_rate > 0.0:
        limit = min(max(limit, num_objects) + SPARE, MOST_USED)
    order = np.argsort(-step.scores, kind="stable")
    return np.asarray(np.sort(order[:limit]))
