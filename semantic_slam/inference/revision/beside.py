"""Objects of a history that may be none, but second boxes of things beside them: where a look is worth a replay."""

from collections.abc import Sequence
from itertools import permutations

import numpy as np

from semantic_slam.inference.object_table import ObjectTable
from semantic_slam.inference.revision.hindsight import HIDES
from semantic_slam.inference.revision.replay import Lineage

REACH = 3.0
"""Standard deviations from a thing within which its second boxes are."""


def seldom_beside(ids: Sequence[int], objects: ObjectTable, lineage: Lineage, second_box_m: float) -> set[int]:
    """Objects near another one without which that was seen at least as often as they were, since they first were.

    ``objects`` (O, ...) over the ``ids``. What is there is detected more often than not.
    """
    exist, places = np.flatnonzero(objects.existence > HIDES).tolist(), objects.object_poses[:, :3]
    near = [
        (ids[one], ids[other])
        for one, other in permutations(exist, 2)
        if np.linalg.norm(places[one] - places[other]) <= REACH * second_box_m
    ]
    seen: dict[int, set[int]] = {number: set() for pair in near for number in pair}
    for keyframe, step in enumerate(lineage):
        for number in seen.keys() & set(step.association):
            seen[number].add(keyframe)
    return {one for one, other in near if _seldom(seen[one], seen[other])}


def _seldom(own: set[int], others: set[int]) -> bool:
    first = min(own, default=0)
    return sum(keyframe > first for keyframe in others - own) >= len(own)
