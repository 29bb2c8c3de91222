"""The semantic factors of a graph: which measurement each is of, where it was made, what is added and made anew."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semantic_slam.inference.semantic_factors import NOWHERE, Named, Places

Index = NDArray[np.int_]


@dataclass(frozen=True)
class Made:
    """The semantic measurements in a graph, with one factor each."""

    named: tuple[Named, ...] = ()
    indices: tuple[int, ...] = ()  # in iSAM2's list of factors
    places: Places = NOWHERE  # where linear factors were made
    keys: Index = field(default_factory=lambda: np.zeros((0, 2), dtype=int), compare=False)  # (n, 2 or 3) of variables
    exact: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=bool), compare=False)  # (n,) callbacks

    def __len__(self) -> int:
        return len(self.named)

    def added(self, named: Sequence[Named], indices: Sequence[int], places: Places) -> "Made":
        """With more of them."""
        if not named:
            return self
        keys = keys_of(named)
        return Made(
            (*self.named, *named),
            (*self.indices, *indices),
            Places.joined([self.places, places]),
            np.concatenate([self.keys, keys]) if len(self.keys) else keys,
            np.concatenate([self.exact, np.array([item.exact for item in named], dtype=bool)]),
        )

    def replaced(self, rows: Sequence[int], named: Sequence[Named], indices: Sequence[int], places: Places) -> "Made":
        """With some made anew."""
        if not rows:
            return self
        all_named, all_indices, exact = list(self.named), list(self.indices), self.exact.copy()
        for row, item, index in zip(rows, named, indices, strict=True):
            all_named[row], all_indices[row], exact[row] = item, index, item.exact
        return Made(tuple(all_named), tuple(all_indices), self.places.replaced(rows, places), self.keys, exact)


NO_FACTORS = Made()


def keys_of(named: Sequence[Named]) -> Index:
    """(n, 2) of robots and objects, or (n, 3) with descriptors."""
    return np.array([item.keys for item in named], dtype=int).reshape(len(named), -1)


@dataclass(frozen=True)
class Added:
    """New semantic measurements, their factors and where these are made."""

    named: Sequence[Named]
    factors: Sequence[Any]
    places: Places


@dataclass(frozen=True)
class Renewal:
    """Semantic measurements whose factors are replaced by linear ones, and where these are made."""

    rows: Sequence[int]
    factors: Sequence[Any]
    places: Places


NONE_ADDED, NONE_RENEWED = Added((), (), NOWHERE), Renewal((), (), NOWHERE)
