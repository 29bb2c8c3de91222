"""Background distribution of embedding vectors, whatever they show, learned online from all vectors seen.

A robot that looks at one object for a long time has not seen more of the world. The background is therefore fitted to
distinct vectors only: a vector is distinct where it is farther from all earlier distinct ones than two vectors that
share half of the total spread so far. The background is an isotropic Gaussian around their mean, with an effective
dimension chosen so that squared distances vary as observed, which is far below the number of components:
nu = (tr S)^2 / tr S^2 (Satterthwaite 1946). Both traces are estimated without bias.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from semantic_slam.geometry.arrays import Array

PRIOR_VECTORS = 1.0
"""Pseudo-count of the prior: a centre at the origin, and the spread of unit vectors."""
PRIOR_DIMENSIONS, PRIOR_DEGREES = 16.0, 16.0
"""Prior effective dimension, and the degrees of freedom that this prior counts for."""


@dataclass(frozen=True, kw_only=True)
class EmbeddingBackground:
    """Density of an embedding vector of an arbitrary object; L components."""

    centre: Array  # (L,)
    spread: float  # expected squared distance from the centre
    dimensions: float  # nu, effective dimension of the isotropic spread


@dataclass(frozen=True, kw_only=True)
class SeenVectors:
    """Statistics of the vectors seen so far: moments of all, and the distinct ones."""

    count: int
    total: Array  # (L,) their sum
    squares: float  # sum of their squared lengths
    distinct: Array  # (N, L)

    @classmethod
    def none(cls, dimensions: int) -> Self:
        """Nothing seen yet."""
        return cls(count=0, total=np.zeros(dimensions), squares=0.0, distinct=np.zeros((0, dimensions)))

    def with_vectors(self, vectors: Array) -> Self:
        """Statistics with (D, L) more vectors; rows of NaN are ignored."""
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
        """Background estimated from the vectors, regularised by the prior for unit vectors."""
        total = self.distinct.sum(axis=0)
        spread = _spread(len(self.distinct), total, float((self.distinct**2).sum()))
        centre = total / (len(self.distinct) + PRIOR_VECTORS)
        return EmbeddingBackground(centre=centre, spread=spread, dimensions=self._dimensions())

    def variances(self, axes: Array) -> Array:
        """(N,) variances of the distinct vectors along (N, L) directions; the prior is isotropic."""
        along = (self.distinct - self.background.centre) @ axes.T
        prior = PRIOR_VECTORS / self.background.dimensions
        return np.asarray(((along**2).sum(axis=0) + prior) / (len(along) + PRIOR_VECTORS))

    def _dimensions(self) -> float:
        """Effective dimension nu, pooled with the prior."""
        degrees = len(self.distinct) - 1
        if degrees < 2:
            return PRIOR_DIMENSIONS
        off = self.distinct - self.distinct.mean(axis=0)
        products = (off @ off.T if len(off) < off.shape[1] else off.T @ off) / degrees  # both have the same traces
        first, second = float(np.trace(products)) ** 2, float((products**2).sum())
        of_squares = degrees**2 / ((degrees - 1.0) * (degrees + 2.0)) * (second - first / degrees)
        squared = max(first - 2.0 * of_squares / degrees, 0.0)
        pooled = degrees * max(of_squares, 0.0) + PRIOR_DEGREES * first / PRIOR_DIMENSIONS
        return float(np.clip(squared * (degrees + PRIOR_DEGREES) / pooled, 1.0, self.distinct.shape[1]))


def _spread(count: int, total: Array, squares: float) -> float:
    """Expected squared distance from the centre, from ``count`` vectors and the prior's pseudo-count."""
    weight = count + PRIOR_VECTORS
    return float((max(squares - float(total @ total) / weight, 0.0) + PRIOR_VECTORS) / weight)
