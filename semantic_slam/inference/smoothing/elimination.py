"""In which order iSAM2 eliminates: last what is read most, for its joint covariance then lies in few cliques."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import gtsam

from semantic_slam.inference.smoothing.semantic_factors import SemanticFactor
from semantic_slam.inference.states.keys import letter_of

MOST_JOINT = 24
"""States up to which their joint covariance costs less than those of single states."""


def last_eliminated(keys: Sequence[int], measurements: Sequence[SemanticFactor] = ()) -> tuple[int, ...]:
    """All objects among some keys and the newest robot, and descriptors of the objects just seen."""
    return _ordered(tuple(keys), tuple(item.descriptor_key for item in measurements if item.descriptor_key is not None))


@lru_cache(maxsize=256)
def _ordered(keys: tuple[int, ...], descriptors: tuple[int, ...]) -> tuple[int, ...]:
    objects = [key for key in keys if letter_of(key) == "o"]
    robot = max(key for key in keys if letter_of(key) == "x")
    if len(objects) >= MOST_JOINT:
        return ()
    return (*objects, robot, *descriptors)


@lru_cache(maxsize=64)
def groups(last: tuple[int, ...]) -> Any:
    """GTSAM's order of elimination with these keys last; None: its own."""
    if not last:
        return None
    groups = gtsam.KeyGroupMap()
    for key in last:
        groups.insert2(key, 1)
    return groups
