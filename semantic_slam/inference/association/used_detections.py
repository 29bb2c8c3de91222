"""Which detections of a keyframe are associated with the objects of a known map; the others are clutter throughout."""

import numpy as np

from semantic_slam.geometry.arrays import Index
from semantic_slam.inference.models.step import Step

SPARE, MOST_USED = 8, 32
"""With clutter: detections beyond the number of objects that are associated in a keyframe, and most of all."""


def used_detections(step: Step, num_objects: int, *, distinct: bool, has_clutter: bool) -> Index:
    """(n,) ascending indices of the best-scored detections of ``step``, as many as there are ``num_objects``.

    Without ``distinct`` objects it is all of them; with clutter some more than there are objects.
    """
    limit = num_objects if distinct else (len(step.names) if num_objects else 0)
    if has_clutter:
        limit = min(max(limit, num_objects) + SPARE, MOST_USED)
    order = np.argsort(-step.scores, kind="stable")
    return np.asarray(np.sort(order[:limit]))
