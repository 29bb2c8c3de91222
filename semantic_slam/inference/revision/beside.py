"""Objects of a history that may be none, but second boxes of things beside them: where a look is worth a replay."""

from collections.abc import Mapping
from itertools import permutations

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.revision.replay import Lineage

REACH = 3.0
"""Standard deviations from a thing within which its second boxes are."""


def seldom_beside(places: Mapping[int, Array], lineage: Lineage, second_box_m: float) -> set[int]:
    """Objects near another one that was seen without them at least as often as they were, since they first were.

    ``places`` (3,) of objects by id, metres. What is there is detected more often than not.
    """
    near = [
        (one, other)
        for one, other in permutations(places, 2)
        if np.linalg.norm(places[one] - places[other]) <= REACH * second_box_m
    ]
    seen: dict[int, set[int]] = {number: set() for pair in near for number in pair}
    for keyframe, step in enumerate(lineage):
        for number in seen.keys() & set(step.association):
            seen[number].add(keyframe)
    return {one for one, other in near if _is_seldom(seen[one], seen[other])}


def _is_seldom(own: set[int], others: set[int]) -> bool:
    first = min(own, default=0)
    return sum(keyframe > first for keyframe in others - own) >= len(own)
