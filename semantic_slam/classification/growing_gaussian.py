"""Gaussians over sequences that grow block-wise: predict the next block, then append it, in O(n^2)."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.classification.growing import GrowingArray, GrowingMatrix
from semantic_slam.geometry.arrays import Array, Index

RELATIVE_FLOOR = 1e-12
"""Smallest conditional variance relative to the processes' largest; below it double precision is exhausted.

One value for all classes, so that a view that all of them predict perfectly favours none.
"""


@dataclass(frozen=True)
class NextBlock:
    """Conditional Gaussian of the next b values given the first n; batch axes come first."""

    shift: Array  # (*batch, b) conditional mean minus mean
    root: Array  # (*batch, b, b) lower factor of the conditional covariance
    gain: Array  # (*batch, n, b) covariance of the first n, inverted, times that with the block: Omega^T of Eq. 3.32


class GrowingGaussian:
    """Batch of zero-mean Gaussians over n observed residuals, n growing in blocks.

    The state is a square root M of the inverse covariance, S^-1 = M^T M. A new block appends rows to it (the inverse of
    a growing Cholesky factor); removing the first value is a Householder reflection that zeroes its column. Both cost
    O(n^2); nothing is refactored.
    """

    def __init__(self, batch: tuple[int, ...], floor: float) -> None:
        """``floor``: lower bound of conditional variances."""
        self._root = GrowingMatrix(batch)  # M
        self._whitened_residual = GrowingArray(batch, ())  # M (z - mean)
        self._floor = floor

    def predict(self, cross: Array, corner: Array) -> NextBlock:
        """Predict the next block from its covariance ``corner`` (*batch, b, b) and ``cross`` (*batch, n, b)."""
        whitened = self._root.values @ cross
        transposed = whitened.swapaxes(-1, -2)
        shift = (transposed @ self._whitened_residual.values[..., None])[..., 0]
        root = floored_cholesky(corner - transposed @ whitened, self._floor)
        return NextBlock(shift, root, self._root.values.swapaxes(-1, -2) @ whitened)

    def append(self, block: NextBlock, residual: Array) -> Array:
        """Append the block with (*batch, b) ``residual`` about its mean; returns its log density (*batch,) in nats."""
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
        """Remove the first value, as if it had never been observed."""
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
        """Replace ``rows`` of the first batch axis by entries ``source`` of ``other``, which has the same length."""
        self._root.values[rows] = other._root.values[source]
        self._whitened_residual.values[rows] = other._whitened_residual.values[source]


def floored_cholesky(covariance: Array, floor: float) -> Array:
    """(*batch, b, b) lower Cholesky factors; eigenvalues of numerically singular matrices are raised to ``floor``."""
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
