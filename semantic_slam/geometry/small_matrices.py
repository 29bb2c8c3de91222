"""Many matrices of two or three rows, entry by entry: far cheaper than a call of LAPACK for each."""

import numpy as np

from semantic_slam.geometry.arrays import Array


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
