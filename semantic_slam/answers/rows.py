"""Which row of a belief is an object's: by its number or its name."""

import numpy as np

from semantic_slam.errors import InputError
from semantic_slam.inference.belief import HybridBelief


def row_of(belief: HybridBelief, object_id: int) -> int:
    """Row of an object in a belief. Raises InputError for an unknown id."""
    rows = np.flatnonzero(belief.object_ids == object_id)
    if not len(rows):
        known = ", ".join(map(str, belief.object_ids.tolist())) or "none"
        raise InputError(f"object {object_id} is not on the map, which has {known}; ask for one of these")
    return int(rows[0])


def row_named(belief: HybridBelief, name: str) -> int:
    """Row of an object given by its name, or where none has that name, by its number in digits. Raises InputError."""
    numbers = [str(n) for n in belief.object_ids.tolist()]
    for names in (list(belief.object_names), numbers):
        if name in names:
            return names.index(name)
    every = zip(numbers, belief.object_names, strict=True)
    known = ", ".join(f"{number} ({own})" if own != number else own for number, own in every)
    raise InputError(f"the map has no object '{name}'; ask for one of {known or 'none: nothing was mapped'}")
