"""Vectors of appearance (CLIP, DINO, any) as points of one length and one dimension.

Only the direction of an embedding counts, so that vectors are scaled to length one. Long ones are projected onto a
fixed random subspace and scaled back: inner products, by which alone the models here know vectors, keep their
expectation and err by a standard deviation of about 1 / sqrt(L) (Johnson, Lindenstrauss 1984).
"""

from functools import cache

import numpy as np

from semantic_slam.geometry.arrays import Array

SEED = 1984
"""Draws the subspace, which has to be the same in every run, for maps and questions are compared across runs."""


def reduced(vectors: Array, dimensions: int) -> Array:
    """(D, L) of the directions of (D, F) vectors, projected, or with zeros where F is below L; NaN: there is none."""
    vectors = np.asarray(vectors, dtype=np.float64)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        largest = np.abs(vectors).max(axis=1, initial=0.0, keepdims=True)
        scaled = vectors / largest  # the squares of what is very large or small would not do
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
    """(F, L) orthonormal columns times sqrt(F / L)."""
    axes, _ = np.linalg.qr(np.random.default_rng([SEED, size, dimensions]).standard_normal((size, dimensions)))
    return np.asarray(axes * np.sqrt(size / dimensions))
