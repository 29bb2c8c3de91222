"""Associations of the first detections of a keyframe, and what they have to do with all the objects.

The Cholesky factor of a partial association's states grows with each detection by one block row; with it grows the
whitened covariance of those states with all others, from which that row is read.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.small_matrices import forward
from semantic_slam.inference.manifold import Manifold
from semantic_slam.inference.observation import ObservationModel
from semantic_slam.inference.stack import Predicted, Rows, Stack

Array = NDArray[np.float64]
Index = NDArray[np.int_]


@dataclass(frozen=True)
class Prefixes:
    """B partial associations of n detections; O objects, d dimensions of a state, m = (1 + n) d."""

    manifold: Manifold
    predicted: Predicted
    rows: Rows
    mean: Array  # (B, 1 + n, d) prior of the robot and the associated objects
    root: Array  # (B, m, m) Cholesky factor of its covariance
    cross: Array  # (B, m, 1 + O, d): root @ cross is the covariance of those states with all

    @classmethod
    def of_robots(cls, manifold: Manifold, predicted: Predicted) -> "Prefixes":
        """One for each parent, of no detection."""
        size, parents = manifold.dimension, np.arange(len(predicted.mean))
        root = np.asarray(np.linalg.cholesky(predicted.covariance[:, :size, :size]), dtype=np.float64)
        rows = Rows(parents, np.zeros((len(parents), 0), dtype=int))
        cross = forward(root, predicted.covariance[:, :size]).reshape(len(parents), size, -1, size)
        return cls(manifold, predicted, rows, predicted.mean[:, :1], root, cross)

    def take(self, selection: Index) -> "Prefixes":
        """Some of them."""
        own = (self.mean[selection], self.root[selection], self.cross[selection])
        return Prefixes(self.manifold, self.predicted, self.rows.take(selection), *own)

    def extended(self, origin: Index, objects: Index) -> "Prefixes":
        """K with one detection more, each going on from its ``origin`` (K,) with one of the ``objects`` (K,).

        An object that its prefix has already needs no state of its own: the block is an independent standard normal.
        """
        before, size = self.take(origin), self.manifold.dimension
        parents, every = before.rows.parents, np.arange(len(origin))
        cross = before.cross.reshape(len(origin), before.cross.shape[1], -1)
        gain = np.ascontiguousarray(np.swapaxes(before.cross[every, :, 1 + objects], 1, 2))  # (K, d, m)
        prior = self.predicted.blocks[parents, 1 + objects]  # (K, d, 1 + O, d)
        again = (before.rows.objects == objects[:, None]).any(axis=1)
        gain[again] = 0.0
        added = prior.reshape(len(origin), size, -1) - gain @ cross
        left = added.reshape(prior.shape)[every, :, 1 + objects]
        left[again] = np.eye(size)
        corner = np.asarray(np.linalg.cholesky(left), dtype=np.float64)
        added = forward(corner, added)
        added[again] = 0.0
        known = cross.shape[1]
        root = np.zeros((len(origin), known + size, known + size))
        root[:, :known, :known], root[:, known:, :known], root[:, known:, known:] = before.root, gain, corner
        place = np.where(again, 0, 1 + objects)
        return Prefixes(
            self.manifold,
            self.predicted,
            Rows(parents, np.concatenate([before.rows.objects, objects[:, None]], axis=1)),
            np.concatenate([before.mean, self.predicted.mean[parents, place][:, None]], axis=1),
            root,
            np.concatenate([cross, added], axis=1).reshape(len(origin), known + size, -1, size),
        )

    def stack(self, model: ObservationModel, seen: object) -> Stack:
        """The small problems of these associations, ``seen`` being their n detections."""
        return Stack(self.manifold, model, seen, self.rows, self.mean, self.root)
