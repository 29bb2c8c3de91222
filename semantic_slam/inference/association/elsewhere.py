"""Mutual exclusion between a mapped object and its displaced twin in the associations of a keyframe."""

from collections.abc import Sequence

import numpy as np

from semantic_slam.geometry.arrays import Flags, Index
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.world.displaced_objects import Displaced


def possible_objects(components: Sequence[Component], object_ids: Index) -> Flags:
    """(P, 1, O) objects that are still possible: False where the history has ruled one out by detecting its partner."""
    gone = [component.objects.ids[component.objects.existence == 0.0] for component in components]
    return np.array([~np.isin(object_ids, own) for own in gone], dtype=bool)[:, None]


def exclusive_objects(displaced: Displaced, object_ids: Index) -> Index:
    """(O,) column of the partner that cannot appear in the same frame as each object; -1: none."""
    columns = {number: at for at, number in enumerate(object_ids.tolist())}
    return np.array([columns.get(displaced.partner.get(n, -1), -1) for n in columns], dtype=int)


def also_gone(displaced: Displaced, object_ids: Index, seen: Flags) -> Flags:
    """(O,) objects that are ruled out because their partners, (O,) ``seen``, were detected."""
    partner = displaced.partner
    return np.isin(object_ids, [partner[n] for n in object_ids[seen].tolist() if n in partner])
