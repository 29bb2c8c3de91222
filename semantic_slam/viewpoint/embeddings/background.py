"""What vectors of appearance are like, whatever they show: learned from all vectors that were seen.

A robot that looks at one thing for long has not seen more of the world. The background is therefore that of distinct
vectors: a next one is distinct where it is farther from all distinct ones before than two vectors are that share half
of the spread of all vectors so far. It is a Gaussian that is the same in all directions about their mean, and has as
many dimensions as a Gaussian whose squared distances vary as theirs do, which are far fewer than vectors have
components: nu = (tr S)^2 / tr S^2 (Satterthwaite 1946). Both traces are estimated without bias.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from semantic_slam.geometry.arrays import Array

PRIOR_VECTORS = 1.0
"""Vectors that count for a centre at the origin and a spread as large as a unit vector's, before any was seen."""
PRIOR_DIMENSIONS, PRIOR_DEGREES = 16.0, 16.0
"""Dimensions before any vector was seen, and as many degrees of freedom as that counts."""


@dataclass(frozen=True, kw_only=True)
class EmbeddingBackground:
    """Density of a vector that shows anything; L components."""

    centre: Array  # (L,)
    spread: float  # expected squared distance from the centre
    dimensions: float  # nu, over which the spread is even


@dataclass(frozen=True, kw_only=True)
class SeenVectors:
    """The vectors seen so far: moments of all, and those that are distinct."""

    count: int
    total: Array  # (L,) their sum
    squares: float  # sum of their squared lengths
    distinct: Array  # (N, L)

    @classmethod
    def none(cls, dimensions: int) -> Self:
        """Nothing seen yet."""
        return cls(count=0, total=np.zeros(dimensions), squares=0.0, distinct=np.zeros((0, dimensions)))

    def with_vectors(self, vectors: Array) -> Self:
        """With (D, L) more; rows of NaN are not vectors."""
        seen = self
        for vector in vectors[np.isfinite(vectors).all(axis=1)]:
            seen = seen._with_vector(vector)
        return seen

    def _with_vector(self, vector: Array) -> Self:
        squares = self.squares + float(vector @ vector)
        seen = replace(self, count=self.count + 1, total=self.total + vector, squares=squares)
        away = ((self.distinct - vector) ** 2).sum(axis=1)
        if len(away) and away.min() <= _spread(seen.count, seen.total, squares):
            return seen
        return replace(seen, distinct=np.vstack([self.distinct, vector]))

    @cached_property
    def background(self) -> EmbeddingBackground:
        """As far as the vectors tell it, and else what is expected of unit vectors."""
        total = self.distinct.sum(axis=0)
        spread = _spread(len(self.distinct), total, float((self.distinct**2).sum()))
        centre = total / (len(self.distinct) + PRIOR_VECTORS)
        return EmbeddingBackground(centre=centre, spread=spread, dimensions=self._dimensions())

    def variances(self, axes: Array) -> Array:
        """(N,) of distinct vectors along (N, L) directions; before any was seen their spread is even."""
        along = (self.distinct - self.background.centre) @ axes.T
        prior = PRIOR_VECTORS / self.background.dimensions
        return np.asarray(((along**2).sum(axis=0) + prior) / (len(along) + PRIOR_VECTORS))

    def _dimensions(self) -> float:
        """nu, of a sum of squares that the prior has a share in."""
        degrees = len(self.distinct) - 1
        if degrees < 2:
            return PRIOR_DIMENSIONS
        off = self.distinct - self.distinct.mean(axis=0)
        products = (off @ off.T if len(off) < off.shape[1] else off.T @ off) / degrees  # either has both traces
        first, second = float(np.trace(products)) ** 2, float((products**2).sum())
        of_squares = degrees**2 / ((degrees - 1.0) * (degrees + 2.0)) * (second - first / degrees)
        squared = max(first - 2.0 * of_squares / degrees, 0.0)
        pooled = degrees * max(of_squares, 0.0) + PRIOR_DEGREES * first / PRIOR_DIMENSIONS
        return float(np.clip(squared * (degrees + PRIOR_DEGREES) / pooled, 1.0, self.distinct.shape[1]))


def _spread(count: int, total: Array, squares: float) -> float:
    """Expected squared distance from the centre, of ``count`` vectors and the prior's."""
    weight = count + PRIOR_VECTORS
    return float((max(squares - float(total @ total) / weight, 0.0) + PRIOR_VECTORS) / weight)
