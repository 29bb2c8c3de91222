"""What a detector calls each class from each direction, before an object has been seen: Dirichlet counts of its words.

Directions are sectors of the object's own frame, counter-clockwise; a single one where they make no difference. How an
object is turned is not known: it is one of as many headings as there are sectors, all as likely.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index

HIDDEN_NONE = 2
"""What none of the labels may mean: called by other words, or by any word."""
DIRECTIONS = 72
"""Cells around an object: the newest view from each is remembered."""
STEP_RAD = 2.0 * np.pi / DIRECTIONS
TURNS = STEP_RAD * np.abs(
    (np.arange(DIRECTIONS)[:, None] - np.arange(DIRECTIONS) + DIRECTIONS // 2) % DIRECTIONS - DIRECTIONS // 2
)
"""(DIRECTIONS, DIRECTIONS) between the cells around an object, in rad."""


@dataclass(frozen=True, kw_only=True)
class Confusion:
    """S sectors, L labels, W = L + 1 words, the last of which is any other one."""

    counts: Array  # (S, L, W) Dirichlet counts of each class
    none: Array  # (HIDDEN_NONE, W) of what none of the labels means
    outlier_share: float  # e

    @classmethod
    def symmetric(cls, num_labels: int, accuracy: float, counts: float, outlier_share: float) -> Self:
        """Most of the counts on the class's own label, the rest spread evenly; from all sides alike."""
        size = num_labels + 1
        spread = np.full((size, size), (1.0 - accuracy) / max(size - 1, 1))
        np.fill_diagonal(spread, accuracy)
        none = np.vstack([spread[-1:], np.full((1, size), 1.0 / size)])
        return cls(counts=counts * spread[None, :-1], none=counts * none, outlier_share=outlier_share)

    @property
    def num_sectors(self) -> int:
        """S, and the number of headings of each class."""
        return len(self.counts)

    @property
    def is_sided(self) -> Flags:
        """(L,) whether a class looks different from some side."""
        return np.asarray((self.counts != self.counts[:1]).any(axis=(0, 2)))

    def rows(self, headings: Index) -> Array:
        """(S, K, W) counts of the words that a view from sector s of the map draws from, K = sum + HIDDEN_NONE.

        First the classes, each with as many of the headings 0 ... S - 1 as (L,) ``headings`` says.
        """
        sectors = self.num_sectors
        numbers = np.arange(sectors)
        seen = self.counts[(numbers[:, None] - numbers) % sectors]  # (sector, heading, L, W)
        classes = seen.transpose(0, 2, 1, 3)[:, numbers < headings[:, None]]
        return np.concatenate([classes, np.broadcast_to(self.none, (sectors, *self.none.shape))], axis=1)

    def sector_of(self, direction: int) -> int:
        """Sector of a cell around an object."""
        return direction * self.num_sectors // DIRECTIONS
