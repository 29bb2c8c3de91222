"""Duplicate-box suspects in the plane: objects that may be nothing but second boxes of things beside them.

Once detected twice, such an object exists for sure in its history, which then outweighs the one without it so far that
pruning drops the latter; afterwards it is missed again and again. In the end the history without it weighs more, and it
enters as soon as pruning would keep it.
"""

from collections.abc import Collection, Mapping
from itertools import permutations

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.revision.hindsight.dissolved import each_without, lineage_of
from semantic_slam.inference.revision.hindsight.planar import PlanarHindsight
from semantic_slam.inference.states.lineage import Lineage

REACH = 2.0
"""Distance, in standard deviations, within which six of seven duplicate boxes of a thing are."""
MISSED = 2
"""Least ratio of detections to misses of a real object."""


def seldom_beside(
    places: Mapping[int, Array], classes: Mapping[int, Array], lineage: Lineage, second_box_m: float
) -> set[int]:
    """Objects beside another one that were missed at least half as often as detected while the other was detected.

    Counted from their first detection on. ``places`` (3,) [m] of objects by id, and probabilities of their ``classes``
    (C,): the duplicate box of a thing is labelled alike.
    """
    near = [
        (one, other)
        for one, other in permutations(places, 2)
        if np.linalg.norm(places[one] - places[other]) <= REACH * second_box_m and _alike(classes[one], classes[other])
    ]
    seen: dict[int, set[int]] = {number: set() for pair in near for number in pair}
    for keyframe, step in enumerate(lineage):
        for number in seen.keys() & set(step.association):
            seen[number].add(keyframe)
    return {one for one, other in near if _is_seldom(seen[one], seen[other])}


def _alike(one: Array, other: Array) -> bool:
    """Whether two objects are of one class with at least chance probability."""
    return not one.size or float(one @ other) * one.size >= 1.0


def _is_seldom(own: set[int], others: set[int]) -> bool:
    first = min(own, default=0)
    return MISSED * sum(keyframe > first for keyframe in others - own) >= len(own)


def without_second_boxes(view: PlanarHindsight, suspects: Collection[int]) -> list[Lineage]:
    """Histories without one of the ``suspects`` each, likeliest first, as far as pruning may keep them."""
    least = -float(np.log(view.problem.pruning.ratio))
    found = [own for own in each_without(view) if own.gain > least and int(view.ids[own.row]) in suspects]
    return [lineage_of(view, own.owners) for own in found]
