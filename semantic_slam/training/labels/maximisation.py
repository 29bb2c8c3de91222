"""What a class is called, from words that are expected to be drawn from that, by levels that lend each other strength.

All classes share how often their own label is right; what one is called else, and from which side, departs from that as
far as there are views: every level counts as many as the one below had before any.
"""

from dataclasses import dataclass, replace

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.training.labels.expectation import Expectation
from semantic_slam.training.labels.passes import Pass
from semantic_slam.viewpoint.labels.confusion import Confusion

OUTLIER_VIEWS = 20.0
"""Views that the outlier share known before counts as."""
NEIGHBOUR_SHARE = 0.25
"""Share of the views of a sector that count for each of its neighbours."""


CLASS_OBJECTS = 1.0
"""Objects of each class that count as seen before any was."""


def class_shares(objects: Array) -> Array:
    """(C,) shares of classes, from (C,) objects of each."""
    return np.asarray((CLASS_OBJECTS + objects) / (CLASS_OBJECTS + objects).sum())


def habit_shares(objects: Array) -> Array:
    """(H,) shares of habits, from (H,) objects that have each; one object is spread evenly before."""
    return np.asarray((1.0 / len(objects) + objects) / (1.0 + objects.sum()))


@dataclass(frozen=True, kw_only=True)
class BeforeFit:
    """What is expected of any detector."""

    num_labels: int
    accuracy: float
    counts: float  # views that every level counts as
    outlier_share: float

    def confusion(self) -> Confusion:
        """What every class alike is called, from all sides."""
        return Confusion.symmetric(self.num_labels, self.accuracy, self.counts, self.outlier_share)

    def fitted(self, own: Pass) -> Confusion:
        """What classes are called from all sides alike, by what a pass has told."""
        told, weights = own.told, own.weights
        drawn = np.tensordot(weights, told.drawn, axes=1)[0]  # (L, W)
        inliers, outliers = float(weights @ told.inliers), float(weights @ told.outliers)
        share = (OUTLIER_VIEWS * self.outlier_share + outliers) / (OUTLIER_VIEWS + inliers + outliers)
        accuracy = (self.counts * self.accuracy + float(np.trace(drawn))) / (self.counts + float(drawn.sum()))
        shared = Confusion.symmetric(self.num_labels, accuracy, self.counts, share)
        classes = self._after(shared.counts, drawn[None])
        return Confusion(counts=classes, none=self.confusion().none, outlier_share=share)

    def by_side(self, told: Expectation, weights: Array, alike: Confusion) -> Confusion:
        """What classes are called from each side, told under settings of (R,) weights; ``alike`` is of all sides."""
        drawn = np.tensordot(weights, told.drawn, axes=1)  # (S, L, W)
        return replace(alike, counts=self._after(np.broadcast_to(alike.counts, drawn.shape), _smoothed(drawn)))

    def _after(self, before: Array, drawn: Array) -> Array:
        """(..., W) counts, as many as before, with their shares after words were drawn."""
        after = before + drawn
        return np.asarray(self.counts * after / after.sum(axis=-1, keepdims=True))


def _smoothed(drawn: Array) -> Array:
    """(S, L, W) with what neighbours tell."""
    beside = np.roll(drawn, 1, axis=0) + np.roll(drawn, -1, axis=0)
    return np.asarray((1.0 - 2.0 * NEIGHBOUR_SHARE) * drawn + NEIGHBOUR_SHARE * beside)
