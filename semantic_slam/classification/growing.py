"""Growing arrays and matrices: append a view, drop the oldest, with amortised copying."""

import numpy as np

from semantic_slam.geometry.arrays import Array

FIRST_CAPACITY = 8


class GrowingArray:
    """(*batch, k, *item) with k growing at the end and shrinking at the front; copies are amortised."""

    def __init__(self, batch: tuple[int, ...], item: tuple[int, ...]) -> None:
        self._axis = len(batch)
        self._data = np.empty((*batch, FIRST_CAPACITY, *item))
        self._start = self._end = 0

    def __len__(self) -> int:
        return self._end - self._start

    @property
    def values(self) -> Array:
        """The current (*batch, k, *item) items, as a view of the buffer."""
        return self._data[(slice(None),) * self._axis + (slice(self._start, self._end),)]

    def append(self, item: Array) -> None:
        """Append one (*batch, *item)."""
        if self._end == self._data.shape[self._axis]:
            self._reserve(2 * len(self) + FIRST_CAPACITY)
        self._end += 1
        self.values[(slice(None),) * self._axis + (-1,)] = item

    def drop_first(self) -> None:
        """Forget the oldest item."""
        self._start += 1

    def _reserve(self, capacity: int) -> None:
        kept = self.values
        shape = list(self._data.shape)
        shape[self._axis] = capacity
        self._data = np.empty(shape)
        self._start, self._end = 0, kept.shape[self._axis]
        self.values[...] = kept


class GrowingMatrix:
    """(*batch, n, n), growing at the lower right and shrinking at the upper left; new entries are zero."""

    def __init__(self, batch: tuple[int, ...]) -> None:
        self._data = np.zeros((*batch, FIRST_CAPACITY, FIRST_CAPACITY))
        self._start = self._end = 0

    def __len__(self) -> int:
        return self._end - self._start

    @property
    def values(self) -> Array:
        """The (*batch, n, n) matrix as it is now, as a view of the buffer."""
        live = slice(self._start, self._end)
        return self._data[..., live, live]

    def grow(self, count: int) -> None:
        """Add ``count`` rows and columns of zeros."""
        if self._end + count > self._data.shape[-1]:
            kept = self.values
            capacity = 2 * kept.shape[-1] + max(count, FIRST_CAPACITY)
            self._data = np.zeros((*kept.shape[:-2], capacity, capacity))
            self._start, self._end = 0, kept.shape[-1]
            self.values[...] = kept
        self._end += count

    def drop_first(self) -> None:
        """Forget the first row and column."""
        self._start += 1
