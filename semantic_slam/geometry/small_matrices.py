"""Batched linear algebra of 2 x 2 and 3 x 3 matrices, element-wise: far cheaper than one LAPACK call each."""

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags

LEAST_VARIANCE = 1e-18
"""Smallest variance accepted: 1 nm^2 or 1 nrad^2, below any real measurement."""
ROUNDING = 1e-9
"""Relative tolerance for rounding in numbers computed elsewhere."""


def cholesky(matrices: Array) -> Array:
    """(B, F, F) lower Cholesky factors, element-wise over the batch: cheaper than one call per small matrix."""
    size = matrices.shape[-1]
    root = np.zeros(matrices.shape)
    for i in range(size):
        for j in range(i + 1):
            entry = matrices[..., i, j]
            for k in range(j):
                entry = entry - root[..., i, k] * root[..., j, k]
            root[..., i, j] = np.sqrt(entry) if i == j else entry / root[..., j, j]
    return root


def forward(root: Array, values: Array) -> Array:
    """(B, F, K) L^-1 values: forward substitution."""
    found = np.empty(values.shape)
    for i in range(root.shape[-1]):
        entry = values[..., i, :]
        for j in range(i):
            entry = entry - root[..., i, j, None] * found[..., j, :]
        found[..., i, :] = entry / root[..., i, i, None]
    return found


def backward(root: Array, values: Array) -> Array:
    """(B, F, K) L^-T values: backward substitution."""
    found = np.empty(values.shape)
    for i in reversed(range(root.shape[-1])):
        entry = values[..., i, :]
        for j in range(i + 1, root.shape[-1]):
            entry = entry - root[..., j, i, None] * found[..., j, :]
        found[..., i, :] = entry / root[..., i, i, None]
    return found


def are_covariances(matrices: Array) -> Flags:
    """(N,) whether each of (N, 2, 2) matrices is a usable covariance; False where it is not finite.

    Required: symmetric up to rounding, variances between LEAST_VARIANCE and its inverse, correlation within 1.
    """
    (a, b), (d, c) = np.moveaxis(matrices, 0, -1)
    with np.errstate(all="ignore"):
        scale = np.sqrt(a * c)
        in_range = (np.minimum(a, c) >= LEAST_VARIANCE) & (np.maximum(a, c) <= 1.0 / LEAST_VARIANCE)
        fits = (np.abs(b - d) <= ROUNDING * scale) & (np.maximum(np.abs(b), np.abs(d)) < (1.0 - ROUNDING) * scale)
    return np.asarray(in_range & fits)
