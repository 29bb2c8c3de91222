"""Confusion prior of a detector: Dirichlet counts of its label words, per class and viewing sector.

Sectors are in the object's own frame, counter-clockwise; a single one where the direction makes no difference. The
object's heading is unknown: one of as many as there are sectors, all equally likely.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index

HIDDEN_NONE = 2
"""Number of hypotheses for the class "none of the labels": called by the other word, or by any word."""
DIRECTIONS = 72
"""Number of azimuth cells around an object."""
STEP_RAD = 2.0 * np.pi / DIRECTIONS
"""Width of an azimuth or elevation cell [rad], and step of the log distances of views."""
TURNS = STEP_RAD * np.abs(
    (np.arange(DIRECTIONS)[:, None] - np.arange(DIRECTIONS) + DIRECTIONS // 2) % DIRECTIONS - DIRECTIONS // 2
)
"""(DIRECTIONS, DIRECTIONS) angles between the azimuth cells around an object, in rad."""


def turns_in_space(around: Index, elevations: Index, elevation: int) -> Array:
    """(P,) angles [rad] between directions in space, from differences of azimuth and from elevations, all in cells.

    By the haversine formula, which is exact for small angles as well.
    """
    aside, rise = np.sin(0.5 * STEP_RAD * around), np.sin(0.5 * STEP_RAD * (elevations - elevation))
    level = np.cos(STEP_RAD * elevations) * np.cos(STEP_RAD * elevation)
    return np.asarray(2.0 * np.arcsin(np.minimum(np.sqrt(rise**2 + level * aside**2), 1.0)))


@dataclass(frozen=True, kw_only=True)
class Confusion:
    """Dirichlet counts over S sectors, L labels and W = L + 1 words, the last of which is any other word."""

    counts: Array  # (S, L, W) Dirichlet counts of each class
    none: Array  # (HIDDEN_NONE, W) of the class "none of the labels"
    outlier_share: float  # e

    @classmethod
    def symmetric(cls, num_labels: int, accuracy: float, counts: float, outlier_share: float) -> Self:
        """Prior with most counts on the class's own label and the rest spread evenly, equal from all sides."""
        size = num_labels + 1
        spread = np.full((size, size), (1.0 - accuracy) / max(size - 1, 1))
        np.fill_diagonal(spread, accuracy)
        none = np.vstack([spread[-1:], np.full((1, size), 1.0 / size)])
        return cls(counts=counts * spread[None, :-1], none=counts * none, outlier_share=outlier_share)

    @property
    def num_sectors(self) -> int:
        """Number of sectors S, which is also the number of headings of each class."""
        return len(self.counts)

    @property
    def is_sided(self) -> Flags:
        """(L,) whether the counts of a class depend on the sector."""
        return np.asarray((self.counts != self.counts[:1]).any(axis=(0, 2)))

    def rows(self, headings: Index) -> Array:
        """(S, K, W) Dirichlet counts for a view from map sector s, with K = sum of ``headings`` + HIDDEN_NONE rows.

        First come the classes, each with the first ``headings`` (L,) of the headings 0 ... S - 1.
        """
        sectors = self.num_sectors
        numbers = np.arange(sectors)
        seen = self.counts[(numbers[:, None] - numbers) % sectors]  # (sector, heading, L, W)
        classes = seen.transpose(0, 2, 1, 3)[:, numbers < headings[:, None]]
        return np.concatenate([classes, np.broadcast_to(self.none, (sectors, *self.none.shape))], axis=1)

    def sector_of(self, direction: int) -> int:
        """Sector that contains an azimuth cell."""
        return direction * self.num_sectors // DIRECTIONS
