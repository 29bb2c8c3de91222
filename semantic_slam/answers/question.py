"""Queries for objects on a map."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from semantic_slam.answers.region import Region
from semantic_slam.errors import InputError
from semantic_slam.foreign_numbers import as_numbers, is_finite
from semantic_slam.geometry.arrays import Array

MAPPED = 0.5
"""Default prior probability that the queried object is on the map at all."""
LONGEST_NAME = 1000


@dataclass(frozen=True, kw_only=True)
class Question:
    """Query by class, by an image's embedding vector, or by a name among named text vectors.

    Raises InputError for an empty query or invalid numbers.
    """

    name: str = ""
    vector: Array | None = None  # (F,) image embedding, of the network that gave the detections' embeddings
    text_vectors: Mapping[str, Array] = field(default_factory=dict)  # name -> (F,), from its text encoder
    region: Region | None = None
    least_probability: float = 0.0
    mapped: float = MAPPED  # prior probability that it is on the map, for vectors

    def __post_init__(self) -> None:
        if not self.name and self.vector is None:
            raise InputError("nothing is looked for; give a name, or a vector of appearance")
        if len(self.name) > LONGEST_NAME:
            raise InputError(f"the name has {len(self.name)} letters; give one of at most {LONGEST_NAME}")
        if self.name and self.vector is not None:
            raise InputError("a name and a vector of a picture are looked for at once; ask for one after the other")
        if self.text_vectors and self.name not in self.text_vectors:
            known = ", ".join(sorted(self.text_vectors))
            raise InputError(f"no text vector is named '{self.name}'; there are {known}")
        for vector in (*self.text_vectors.values(), *([] if self.vector is None else [self.vector])):
            _check_vector(vector)
        check_limits(self.region, self.least_probability)
        if not 0.0 < self.mapped < 1.0:
            raise InputError("the probability of being mapped must lie between 0 and 1; correct it")


def _check_vector(vector: Array) -> None:
    """Raise InputError for what is no embedding."""
    numbers = as_numbers(vector)
    if numbers.ndim != 1 or not numbers.size or not np.isfinite(numbers).all():
        raise InputError("a vector of appearance must be one row of finite numbers; give what the network gave")


def check_limits(region: Region | None, least_probability: float) -> None:
    """Raise InputError for an invalid region, or a number that is not a probability."""
    if not (is_finite(least_probability) and 0.0 <= least_probability <= 1.0):
        raise InputError("the least probability must lie between 0 and 1; correct it")
    if region is None:
        return
    corners = as_numbers(region)
    if corners.shape != (4,) or not np.isfinite(corners).all() or (corners[:2] >= corners[2:]).any():
        raise InputError("the region must be x_min y_min x_max y_max in metres, with x_min below x_max; correct it")
