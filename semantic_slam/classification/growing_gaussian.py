"""Gaussians over sequences that grow block by block: predict the next block, then take it in, in O(n^2)."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.classification.growing import GrowingArray, GrowingMatrix
from semantic_slam.geometry.arrays import Array, Index

RELATIVE_FLOOR = 1e-12
"""Least conditional variance, as a share of the processes' greatest: below it a difference of doubles means nothing.

One number for all classes, so that a view that all of them predict perfectly favours none.
"""


@dataclass(frozen=True)
class NextBlock:
    """The next b values of a sequence given its first n, about their mean; batch shape before all others."""

    shift: Array  # (*batch, b) conditional mean minus mean
    root: Array  # (*batch, b, b) lower factor of the conditional covariance
    gain: Array  # (*batch, n, b) covariance of the first n, inverted, times that with the block: Omega^T of Eq. 3.32


class GrowingGaussian:
    """Batch of zero-mean Gaussians over n values of which the residuals are known, n growing in blocks.

    Kept is a square root of the inverse covariance S^-1 = M^T M. A new block adds rows to it (a growing Cholesky
    factor, inverted), and leaving the first value out is a Householder reflection that empties its column: both are
    O(n^2), and nothing is ever made anew.
    """

    def __init__(self, batch: tuple[int, ...], floor: float) -> None:
        """``floor``: least conditional variance of a value."""
        self._root = GrowingMatrix(batch)  # M
        self._whitened_residual = GrowingArray(batch, ())  # M (z - mean)
        self._floor = floor

    def predict(self, cross: Array, corner: Array) -> NextBlock:
        """Gaussian of the next block, of covariance ``corner`` (*batch, b, b) and ``cross`` (*batch, n, b)."""
        whitened = self._root.values @ cross
        transposed = whitened.swapaxes(-1, -2)
        shift = (transposed @ self._whitened_residual.values[..., None])[..., 0]
        root = floored_cholesky(corner - transposed @ whitened, self._floor)
        return NextBlock(shift, root, self._root.values.swapaxes(-1, -2) @ whitened)

    def append(self, block: NextBlock, residual: Array) -> Array:
        """Take in the block with (*batch, b) ``residual`` about its mean; returns its log density (*batch,) in nats."""
        size = residual.shape[-1]
        inverse = np.linalg.inv(block.root)
        innovation = (inverse @ (residual - block.shift)[..., None])[..., 0]
        self._root.grow(size)
        rows = self._root.values[..., -size:, :]
        rows[..., :-size] = -inverse @ block.gain.swapaxes(-1, -2)
        rows[..., -size:] = inverse
        for index in range(size):
            self._whitened_residual.append(innovation[..., index])
        logdet = np.log(np.diagonal(block.root, axis1=-2, axis2=-1)).sum(axis=-1)
        return np.asarray(-0.5 * np.square(innovation).sum(axis=-1) - logdet - 0.5 * size * np.log(2.0 * np.pi))

    def drop_first(self) -> None:
        """Leave the first value out, as if it had never been observed."""
        root, residual = self._root.values, self._whitened_residual.values
        mirror = root[..., 0].copy()  # (*batch, n): reflected onto the first row, which is left out with the column
        mirror[..., 0] += np.copysign(np.linalg.norm(mirror, axis=-1), mirror[..., 0])
        scale = (2.0 / np.square(mirror).sum(axis=-1))[..., None]
        row = scale * (mirror[..., None, :] @ root)[..., 0, :]
        root[..., 1:, 1:] -= mirror[..., 1:, None] * row[..., None, 1:]
        residual[..., 1:] -= mirror[..., 1:] * (scale * (mirror * residual).sum(axis=-1, keepdims=True))
        self._root.drop_first()
        self._whitened_residual.drop_first()

    def replace(self, rows: Index, other: "GrowingGaussian", source: Index) -> None:
        """Take entries ``source`` of ``other``, of the same length, for the ``rows`` of the first batch axis."""
        self._root.values[rows] = other._root.values[source]
        self._whitened_residual.values[rows] = other._whitened_residual.values[source]


def floored_cholesky(covariance: Array, floor: float) -> Array:
    """(*batch, b, b) lower factors; a covariance that is singular to rounding gets no eigenvalue below ``floor``."""
    if covariance.shape[-1] == 1:
        return np.sqrt(np.maximum(covariance, floor))
    try:
        root = np.linalg.cholesky(covariance)
    except np.linalg.LinAlgError:
        root = None
    if root is not None and np.all(np.square(np.diagonal(root, axis1=-2, axis2=-1)) >= floor):
        return np.asarray(root)
    eigenvalues, vectors = np.linalg.eigh(covariance)
    lifted = np.maximum(eigenvalues, floor)
    return np.asarray(np.linalg.cholesky((vectors * lifted[..., None, :]) @ vectors.swapaxes(-1, -2)))
