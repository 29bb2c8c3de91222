"""Small arrays, for which what NumPy does before it begins costs more than the numbers."""

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int_]
Flags = NDArray[np.bool_]
Bytes = NDArray[np.uint8]
"""Pictures and crops, RGB in the last axis."""
T = TypeVar("T", bound=np.generic)


def broadcast_copy(values: NDArray[T], shape: tuple[int, ...]) -> NDArray[T]:
    """``values`` over a shape that they broadcast to, an array of their own: many times faster than a view of them."""
    found: NDArray[Any] = np.empty(shape, dtype=values.dtype)
    found[...] = values
    return found


def squared_norms(vectors: Array) -> Array:
    """(...,) of (..., n): many times faster than a sum over an axis that is short."""
    return np.asarray(np.vecdot(vectors, vectors))


def row_sums(values: Array) -> Array:
    """(...,) sums of (..., n) over the last axis: many times faster than a sum over an axis that is short."""
    return np.asarray(np.vecdot(values, np.ones(values.shape[-1])))


def distinct_rows(rows: Index) -> tuple[Index, Index]:
    """(K, n) the different ones of (B, n) rows, ascending, and (B,) which of them each is.

    Of a few rows several times as fast as NumPy's.
    """
    every = [tuple(row) for row in rows.tolist()]
    distinct = sorted(set(every))
    place = {row: number for number, row in enumerate(distinct)}
    found = np.array(distinct, dtype=rows.dtype).reshape(len(distinct), rows.shape[1])
    return found, np.array([place[row] for row in every], dtype=int)


TILE = 8
"""Rows that a product takes at a time, on no processor more."""


def row_products(rows: Array, matrix: Array) -> Array:
    """(B, n) products of (B, m) with (m, n): each row's to the last bit the same, whatever rows stand beside it.

    Of a number of rows that is no multiple of its tile, BLAS rounds the last ones otherwise on some processors.
    """
    missing = -len(rows) % TILE
    if not missing:
        return np.asarray(rows @ matrix)
    return np.asarray((np.concatenate([rows, np.zeros((missing, rows.shape[1]))]) @ matrix)[: len(rows)])


def column_products(matrices: Array, columns: Array) -> Array:
    """(..., m, n) products of (..., m, k) with (..., k, n): each column's to the last bit the same in every company.

    Padded and laid out row by row, as :func:`row_products` is padded.
    """
    missing = -columns.shape[-1] % TILE
    padded = np.concatenate([columns, np.zeros((*columns.shape[:-1], missing))], axis=-1)
    return np.asarray((matrices @ np.ascontiguousarray(padded))[..., : columns.shape[-1]])


def diagonals(matrices: Array) -> Array:
    """(B, n) of contiguous (B, n, n), to write to as well."""
    return matrices.reshape(len(matrices), matrices.shape[1] ** 2)[:, :: matrices.shape[1] + 1]
