"""Operations on small arrays, where NumPy's per-call overhead costs more than the arithmetic."""

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int_]
Flags = NDArray[np.bool_]
Bytes = NDArray[np.uint8]
"""Images and crops, uint8, RGB in the last axis."""
T = TypeVar("T", bound=np.generic)


def broadcast_copy(values: NDArray[T], shape: tuple[int, ...]) -> NDArray[T]:
    """Copy of ``values`` broadcast to ``shape``: many times faster than ``np.broadcast_to``."""
    found: NDArray[Any] = np.empty(shape, dtype=values.dtype)
    found[...] = values
    return found


def squared_norms(vectors: Array) -> Array:
    """(...,) squared norms of (..., n) vectors: many times faster than a sum over a short axis."""
    return np.asarray(np.vecdot(vectors, vectors))


def row_sums(values: Array) -> Array:
    """(...,) sums of (..., n) over the last axis: many times faster than ``sum`` over a short axis."""
    return np.asarray(np.vecdot(values, np.ones(values.shape[-1])))


def distinct_rows(rows: Index) -> tuple[Index, Index]:
    """(K, n) unique rows of (B, n), ascending, and for each of the B rows the index of its unique row.

    For a few rows several times as fast as ``np.unique``.
    """
    every = [tuple(row) for row in rows.tolist()]
    distinct = sorted(set(every))
    place = {row: number for number, row in enumerate(distinct)}
    found = np.array(distinct, dtype=rows.dtype).reshape(len(distinct), rows.shape[1])
    return found, np.array([place[row] for row in every], dtype=int)


def places_among(ascending: Index, values: Index) -> tuple[Index, Flags]:
    """(...,) places of ``values`` among distinct ``ascending`` numbers (n,), and whether they are there.

    For a few values several times as fast as ``np.isin``.
    """
    places = ascending.searchsorted(values)
    there = places < len(ascending)
    there[there] = ascending[places[there]] == values[there]
    return places, there


TILE = 8
"""Number of rows that a BLAS kernel processes at a time, at most, on any processor."""


def row_products(rows: Array, matrix: Array) -> Array:
    """(B, n) product of (B, m) with (m, n), bit-identical for each row whatever the other rows are.

    Where the number of rows is no multiple of the tile, BLAS rounds the last ones differently on some processors, so
    the rows are padded to a multiple of :data:`TILE`.
    """
    missing = -len(rows) % TILE
    if not missing:
        return np.asarray(rows @ matrix)
    return np.asarray((np.concatenate([rows, np.zeros((missing, rows.shape[1]))]) @ matrix)[: len(rows)])


def column_products(matrices: Array, columns: Array) -> Array:
    """(..., m, n) product of (..., m, k) with (..., k, n), bit-identical for each column whatever the others are.

    The columns are padded as in :func:`row_products` and stored in row-major order.
    """
    missing = -columns.shape[-1] % TILE
    padded = np.concatenate([columns, np.zeros((*columns.shape[:-1], missing))], axis=-1)
    return np.asarray((matrices @ np.ascontiguousarray(padded))[..., : columns.shape[-1]])


def diagonals(matrices: Array) -> Array:
    """(B, n) diagonals of contiguous (B, n, n) matrices, as a writable view."""
    return matrices.reshape(len(matrices), matrices.shape[1] ** 2)[:, :: matrices.shape[1] + 1]
