"""Normalisation of embedding vectors (CLIP, DINO, any) to unit length and a fixed dimension.

Only the direction of an embedding matters, so vectors are scaled to unit length. High-dimensional ones are projected
onto a fixed random subspace and rescaled: inner products, the only quantity the models here use, keep their
expectation, with a standard deviation of about 1 / sqrt(L) (Johnson, Lindenstrauss 1984).
"""

from functools import cache

import numpy as np

from semantic_slam.geometry.arrays import Array

SEED = 1984
"""Seed of the random subspace, which must be equal in every run: maps and queries are compared across runs."""


def reduced(vectors: Array, dimensions: int) -> Array:
    """(D, L) unit vectors of (D, F) vectors, projected, or zero-padded where F < L; NaN rows: no vector."""
    vectors = np.asarray(vectors, dtype=np.float64)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        largest = np.abs(vectors).max(axis=1, initial=0.0, keepdims=True)
        scaled = vectors / largest  # avoids overflow and underflow of the squares
        unit = scaled / np.sqrt((scaled**2).sum(axis=1, keepdims=True))
    size = vectors.shape[1]
    unit[~np.isfinite(unit).all(axis=1)] = np.nan
    if size > dimensions:
        return np.asarray(unit @ _subspace(size, dimensions))
    return (
        np.asarray(np.pad(unit, ((0, 0), (0, dimensions - size)))) if size else np.full((len(unit), dimensions), np.nan)
    )


@cache
def _subspace(size: int, dimensions: int) -> Array:
    """(F, L) projection matrix: orthonormal columns times sqrt(F / L)."""
    axes, _ = np.linalg.qr(np.random.default_rng([SEED, size, dimensions]).standard_normal((size, dimensions)))
    return np.asarray(axes * np.sqrt(size / dimensions))
