"""Objects that were moved since the map was made: each mapped object gets a displaced twin with a wider prior.

A history contains only one of the two, decided by the first detection of either. Until then the twin's existence is the
prior probability that the object was moved.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import covariance_from_planar
from semantic_slam.inference.world.map_prior import MapPrior


@dataclass(frozen=True)
class Displaced:
    """Object ids of the displaced twins of mapped objects."""

    elsewhere: Mapping[int, int] = field(default_factory=dict)  # id of the mapped object -> id of its displaced twin
    covariance: Array = field(default_factory=lambda: np.zeros((6, 6)))  # of a twin about the mapped object

    @cached_property
    def on_map(self) -> dict[int, int]:
        """Id of a displaced twin -> id of the mapped object."""
        return {other: own for own, other in self.elsewhere.items()}

    @cached_property
    def partner(self) -> dict[int, int]:
        """Either id of such a pair -> the other one, with which it is mutually exclusive."""
        return {**self.elsewhere, **self.on_map}


def with_displaced(prior: MapPrior, share: float, sigma_m: float, first: int) -> tuple[MapPrior, Displaced]:
    """The map with a displaced twin for each object: ``share`` of them were moved, by ``sigma_m`` along x and along y.

    An object and its twin split the existence probability that the map states. Twins have ids from ``first`` on. With a
    share of 0 nothing is added. Where the map states a joint covariance, a twin is about its object, wherever that is.
    """
    if share <= 0.0:
        return prior, Displaced()
    moved = covariance_from_planar(np.diag([sigma_m**2, sigma_m**2, 0.0]))
    there = [replace(item, existence=item.existence * (1.0 - share)) for item in prior.objects]
    elsewhere = [
        replace(
            item,
            object_id=first + row,
            name=f"{item.name}_moved",
            covariance=item.covariance + moved,
            existence=item.existence * share,
        )
        for row, item in enumerate(prior.objects)
    ]
    numbers = {own.object_id: other.object_id for own, other in zip(there, elsewhere, strict=True)}
    return replace(prior, objects=(*there, *elsewhere)), Displaced(numbers, moved)
