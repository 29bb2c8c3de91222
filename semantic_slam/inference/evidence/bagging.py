"""Bagged posterior over the robot's place: weights averaged over bootstrap samples of the keyframes.

A weight is a product over keyframes, each of which counts as if the models were exact. If they are not, log weight
differences that fluctuate from keyframe to keyframe decide between places although the data do not. The bagged
posterior is robust to this: the average of the posteriors given resampled data (Buehlmann 2014; Huggins and Miller
2023). Here whole keyframes are resampled, each Poisson(1) times. Among histories with the robot at about the same place
the relative weights stay unchanged.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.states.identity import generator


@dataclass(frozen=True)
class Bagging:
    """B bootstrap sets of keyframes; a history's replicates (B,) are its log weights given each set."""

    seed: int
    num_replicates: int  # B; 0: none, weights are unchanged

    def begun(self, log_weight: float) -> Array:
        """(B,) replicates of a history before the first keyframe."""
        return np.full(self.num_replicates, log_weight)

    def grown(self, replicates: Array, keyframe: int, log_psi: float) -> Array:
        """(B,) replicates of a history after keyframe ``keyframe``, which multiplied its weight by psi."""
        if self.num_replicates == 0:
            return replicates
        return np.asarray(replicates + _times(self.seed, self.num_replicates, keyframe) * log_psi)

    def log_weights(self, log_weights: Array, replicates: Array, kinds: Index) -> Array:
        """(H,) bagged log weights, from normalised ones (H,) and replicates (H, B), for clusters ``kinds`` (H,)."""
        every = np.unique(kinds)
        if self.num_replicates == 0 or len(every) == 1:
            return log_weights
        of_sets = replicates - np.logaddexp.reduce(replicates, axis=0)
        found = log_weights.copy()
        for kind in every.tolist():
            rows = kinds == kind
            share = np.logaddexp.reduce(of_sets[rows], axis=None) - np.log(self.num_replicates)
            found[rows] += share - np.logaddexp.reduce(log_weights[rows])
        return np.asarray(found - np.logaddexp.reduce(found))


@lru_cache(maxsize=4096)
def _times(seed: int, num_replicates: int, keyframe: int) -> Array:
    """(B,) multiplicity of a keyframe in each bootstrap set."""
    return generator(seed, "bagging", 0, keyframe).poisson(1.0, num_replicates).astype(float)
