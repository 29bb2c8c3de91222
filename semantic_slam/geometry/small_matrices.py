"""Many matrices of two or three rows, entry by entry: far cheaper than a call of LAPACK for each."""

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags

LEAST_VARIANCE = 1e-18
"""A square nanometre, or nanoradian: nothing is measured better."""
ROUNDING = 1e-9
"""Relative; numbers that others computed differ by as much."""


def cholesky(matrices: Array) -> Array:
    """(B, F, F) lower factors, entry by entry: for many small matrices far cheaper than one by one."""
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
    """(N,) whether each of (N, 2, 2) is a covariance that can be computed with; False for those that are not finite.

    Symmetric but for rounding, its variances between LEAST_VARIANCE and its inverse, its correlation within 1.
    """
    (a, b), (d, c) = np.moveaxis(matrices, 0, -1)
    with np.errstate(all="ignore"):
        scale = np.sqrt(a * c)
        in_range = (np.minimum(a, c) >= LEAST_VARIANCE) & (np.maximum(a, c) <= 1.0 / LEAST_VARIANCE)
        fits = (np.abs(b - d) <= ROUNDING * scale) & (np.maximum(np.abs(b), np.abs(d)) < (1.0 - ROUNDING) * scale)
    return np.asarray(in_range & fits)
