"""Principal components of plain crops: what the extractor of the MAP formulation learns to see through a room."""

from dataclasses import dataclass

import numpy as np
from sklearn.utils.extmath import randomized_svd

from semantic_slam.geometry.arrays import Array, Bytes


@dataclass(frozen=True)
class PrincipalComponents:
    """Targets t = (pixels - mean) @ basis / scale of D pixels and K components."""

    mean: Array  # (D,)
    basis: Array  # (D, K)
    scale: Array  # (K,)

    def targets(self, crops: Bytes) -> Array:
        """(N, K) of (N, size, size, 3) crops."""
        return np.asarray((_pixels(crops) - self.mean) @ self.basis / self.scale)


def principal_components(crops: Bytes, count: int, seed: int) -> PrincipalComponents:
    """The ``count`` strongest components of (N, size, size, 3) crops, each divided by the root of its spread.

    Dividing by the whole spread would make noise of the weak ones; by nothing, the strong ones, light and size, all.
    """
    pixels = _pixels(crops)
    mean = pixels.mean(axis=0)
    _, strength, basis = randomized_svd(pixels - mean, count, n_iter=3, random_state=seed)
    spread = strength / np.sqrt(len(pixels))
    return PrincipalComponents(mean, basis.T, np.sqrt(spread))


def _pixels(crops: Bytes) -> Array:
    return crops.reshape(len(crops), -1).astype(np.float64) / 255.0
