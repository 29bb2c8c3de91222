"""Objects of a history in the plane that may be none, but second boxes of things beside them.

Seen twice, such an object exists for good, in a history that soon weighs so much more than one in which it is none that
pruning gives that up; and then it is missed, again and again. The history without it weighs more in the end, and as
much as that it enters once pruning would keep it.
"""

from collections.abc import Collection, Mapping
from itertools import permutations

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.revision.hindsight.dissolved import each_without, lineage_of
from semantic_slam.inference.revision.hindsight.planar import PlanarHindsight
from semantic_slam.inference.revision.replay import Lineage

REACH = 2.0
"""Standard deviations from a thing within which six of seven of its second boxes are."""
MISSED = 2
"""What is there is detected that many times as often as missed, or more."""


def seldom_beside(
    places: Mapping[int, Array], classes: Mapping[int, Array], lineage: Lineage, second_box_m: float
) -> set[int]:
    """Objects near another one that was seen without them half as often as they were or more, since they first were.

    ``places`` (3,) of objects by id, metres, and probabilities of their ``classes`` (C,): halves of a thing are called
    what it is.
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
    """Whether two objects are of one class at least as likely as by chance."""
    return not one.size or float(one @ other) * one.size >= 1.0


def _is_seldom(own: set[int], others: set[int]) -> bool:
    first = min(own, default=0)
    return MISSED * sum(keyframe > first for keyframe in others - own) >= len(own)


def without_second_boxes(view: PlanarHindsight, suspects: Collection[int]) -> list[Lineage]:
    """Histories without one of the ``suspects`` each, likeliest first, those that pruning may keep."""
    least = -float(np.log(view.problem.pruning.ratio))
    found = [own for own in each_without(view) if own.gain > least and int(view.ids[own.row]) in suspects]
    return [lineage_of(view, own.owners) for own in found]
