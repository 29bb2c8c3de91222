"""Which of two objects that are one, where the map has it and where it was moved, a keyframe may be about."""

from collections.abc import Sequence

import numpy as np

from semantic_slam.geometry.arrays import Flags, Index
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.world.displaced_objects import Displaced


def possible_objects(components: Sequence[Component], object_ids: Index) -> Flags:
    """(P, 1, O) objects that histories have not seen elsewhere already."""
    gone = [component.objects.ids[component.objects.existence == 0.0] for component in components]
    return np.array([~np.isin(object_ids, own) for own in gone], dtype=bool)[:, None]


def exclusive_objects(displaced: Displaced, object_ids: Index) -> Index:
    """(O,) column of the object that no frame shows beside each one; -1: any."""
    columns = {number: at for at, number in enumerate(object_ids.tolist())}
    return np.array([columns.get(displaced.partner.get(n, -1), -1) for n in columns], dtype=int)


def also_gone(displaced: Displaced, object_ids: Index, seen: Flags) -> Flags:
    """(O,) objects that do not exist because (O,) others were ``seen``."""
    partner = displaced.partner
    return np.isin(object_ids, [partner[n] for n in object_ids[seen].tolist() if n in partner])
