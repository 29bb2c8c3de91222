"""What a detector's labels tell where there are no classes: what may move is none of what never does.

By its label (``moving.share_by_label``) a detection is of a thing that may move, or of one that does not. An object is
what the detection says that began it; a later one that says otherwise is mistaken, as few are.
"""

from collections.abc import Sequence

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.models.moving import Moving
from semantic_slam.inference.world.objects import ObjectRegistry

LOG_MISTAKEN = float(np.log(0.02))
"""Log probability that a detector takes what may move for what does not, or the other way round."""
NOT_TOLD = -1


class LabelsApart:
    """Log factors of detections as ones of objects, by what both are called."""

    def __init__(self, moving: Moving, registry: ObjectRegistry) -> None:
        self._moving, self._registry = moving, registry

    def log_factors(self, labels: Sequence[str], object_ids: Index) -> Array:
        """(D, M) of D labels, those of detections, and M ids of objects; 0 where one of both is not told."""
        if not self._moving.is_on:
            return np.zeros((len(labels), len(object_ids)))
        seen, known = self._kinds(labels), self._kinds([self._registry.label_of(int(n)) for n in object_ids])
        differ = (seen[:, None] != known) & (seen[:, None] != NOT_TOLD) & (known != NOT_TOLD)
        return np.where(differ, LOG_MISTAKEN, 0.0)

    def log_factor(self, labels: Sequence[str], object_ids: Index) -> Array:
        """(K,) of K joint assignments of D detections to ``object_ids`` (K, D)."""
        if not self._moving.is_on or not len(labels) or not len(object_ids):
            return np.zeros(len(object_ids))
        every, places = np.unique(object_ids, return_inverse=True)
        table = self.log_factors(labels, every)
        return np.asarray(table[np.arange(len(labels)), places.reshape(object_ids.shape)].sum(axis=1))

    def _kinds(self, labels: Sequence[str]) -> Index:
        """(n,) 1: what is called so may move; 0: it does not."""
        may_move = self._moving.shares(labels) > 0.0
        is_told = np.array([bool(label) for label in labels], dtype=bool)
        return np.where(is_told, may_move.astype(int), NOT_TOLD)
