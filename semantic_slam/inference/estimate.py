"""The states of all variables of a smoother, read at once."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import gtsam
import numpy as np
from numpy.typing import NDArray

from semantic_slam.inference.linear_factors import DESCRIPTOR
from semantic_slam.inference.manifold import Manifold
from semantic_slam.inference.semantic_factors import Places

Array = NDArray[np.float64]
Index = NDArray[np.int_]


@dataclass(frozen=True)
class Estimate:
    """n poses and m descriptors, whose keys come first."""

    keys: Index  # (m + n,) ascending
    descriptors: Array  # (m, L)
    poses: Array  # (n, d)

    @classmethod
    def of(cls, manifold: Manifold, values: gtsam.Values, num_descriptors: int) -> "Estimate":
        """From GTSAM's values."""
        descriptors = gtsam.utilities.extractVectors(values, DESCRIPTOR) if num_descriptors else np.zeros((0, 0))
        return cls(_ascending(tuple(values.keys())), descriptors, manifold.states(values))

    def states(self, keys: Sequence[int] | Index) -> Array:
        """(..., d) of poses (...,)."""
        return np.asarray(self.poses[np.searchsorted(self._pose_keys, keys)])

    def places(self, keys: Index) -> Places:
        """Of the variables of some semantic measurements, (B, 2) keys or with descriptors (B, 3)."""
        at = self.states(keys[:, :2])
        descriptors = np.zeros((len(keys), 0))
        if len(self.descriptors):
            descriptors = self.descriptors[np.searchsorted(self.keys[: len(self.descriptors)], keys[:, 2])]
        return Places(at[:, 0], at[:, 1], descriptors)

    @property
    def _pose_keys(self) -> Index:
        return self.keys[len(self.keys) - len(self.poses) :]


@lru_cache(maxsize=256)
def _ascending(keys: tuple[int, ...]) -> Index:
    """The same as an array: smoothers of one keyframe share it."""
    return np.array(keys, dtype=int)
