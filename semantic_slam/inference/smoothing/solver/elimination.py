"""Elimination order of iSAM2: what is read most comes last, so that its joint covariance lies in few cliques."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import gtsam

from semantic_slam.inference.smoothing.semantic_factors import SemanticFactor
from semantic_slam.inference.states.keys import letter_of

MOST_JOINT = 24
"""Number of states up to which their joint covariance costs less than single marginals."""


def last_eliminated(keys: Sequence[int], measurements: Sequence[SemanticFactor] = ()) -> tuple[int, ...]:
    """All objects among some keys and the newest robot, and the descriptors of objects just seen; none if too many."""
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
    """GTSAM's ordering constraint with these keys last; None: GTSAM's own order."""
    if not last:
        return None
    groups = gtsam.KeyGroupMap()
    for key in last:
        groups.insert2(key, 1)
    return groups
