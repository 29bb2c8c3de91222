"""Objects that were moved since a map was made: each is one more object about where the map has it, in its stead.

Of an object and the same one elsewhere a history has one: which, its first detection decides. Until then the second has
the prior probability that the object was moved.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from semantic_slam.geometry.pose import covariance_from_planar
from semantic_slam.inference.world.map_prior import MapPrior


@dataclass(frozen=True)
class Displaced:
    """Under which number an object of the map goes where it stands elsewhere."""

    elsewhere: Mapping[int, int] = field(default_factory=dict)  # id of the object on the map -> id of it elsewhere

    @cached_property
    def on_map(self) -> dict[int, int]:
        """Id of an object elsewhere -> id that it has on the map."""
        return {other: own for own, other in self.elsewhere.items()}

    @cached_property
    def partner(self) -> dict[int, int]:
        """Either id of an object -> the other one, which excludes it."""
        return {**self.elsewhere, **self.on_map}


def with_displaced(prior: MapPrior, share: float, sigma_m: float, first: int) -> tuple[MapPrior, Displaced]:
    """The map with each of its objects elsewhere, too: ``share`` of them were moved, ``sigma_m`` along x and along y.

    The two share the existence that the map states. What is added is numbered from ``first`` on; it is nothing where no
    share was moved.
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
    return replace(prior, objects=(*there, *elsewhere)), Displaced(numbers)
