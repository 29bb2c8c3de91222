"""The states of all variables of a smoother, read from iSAM2 in one call."""

from collections.abc import Sequence
from dataclasses import dataclass

import gtsam
import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.smoothing.semantic_factors import LinearisationPoints
from semantic_slam.inference.states.keys import DESCRIPTOR
from semantic_slam.inference.states.layout import Layout
from semantic_slam.inference.states.spaces import Spaces


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """n robot and object states and m descriptors; keys of descriptors come first."""

    keys: Index  # (m + n,) ascending
    descriptors: Array  # (m, L)
    poses: Array  # (n, s)
    storage: Layout  # of robots and objects

    @classmethod
    def of(cls, spaces: Spaces, values: gtsam.Values, num_descriptors: int) -> "Estimate":
        """The estimate in GTSAM ``values``; variables of other kinds have smaller keys and are left out."""
        descriptors = gtsam.utilities.extractVectors(values, DESCRIPTOR) if num_descriptors else np.zeros((0, 0))
        poses, keys = spaces.states(values), np.array(values.keys(), dtype=int)
        return cls(
            keys=keys[len(keys) - len(poses) - len(descriptors) :],
            descriptors=descriptors,
            poses=poses,
            storage=spaces.storage,
        )

    def states(self, keys: Sequence[int]) -> Array:
        """(B, s) estimated states of robots and objects by their keys. Raises KeyError."""
        wanted = np.array(keys, dtype=int)
        rows = np.searchsorted(self.keys, wanted)
        if rows.max(initial=-1) >= len(self.keys) or (self.keys[rows] != wanted).any():
            raise KeyError(f"no variables {sorted(set(wanted.tolist()) - set(self.keys.tolist()))}")
        return np.asarray(self.poses[rows - len(self.descriptors)])

    def points(self, keys: Index) -> LinearisationPoints:
        """Linearisation points of the variables of semantic measurements: keys (B, 2), or with descriptors (B, 3)."""
        rows = np.searchsorted(self.keys, keys)
        states = self.storage.joined(self.poses[rows[:, :2] - len(self.descriptors)])
        if len(self.descriptors):
            states = np.concatenate([states, self.descriptors[rows[:, 2]]], axis=1)
        return LinearisationPoints(states, self.storage)
