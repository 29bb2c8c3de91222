"""How sure evidence is of where the robot is: weights averaged over resampled sets of the keyframes they come from.

A weight is a product over keyframes, each of which counts as if the models were exact. Where they are not, a sum of
nats that now rises and now falls settles what the data leave open. The bagged posterior says so: the average of the
posteriors given data drawn anew from the data (Buehlmann 2014; Huggins and Miller 2023), here whole keyframes, as often
as Poisson's distribution of mean one has it. Between histories in which the robot is about at one place weights stay
what they are.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.states.identity import generator


@dataclass(frozen=True)
class Bagging:
    """B resampled sets of keyframes; a history's replicates (B,) are the logs of its weights given each."""

    seed: int
    num_replicates: int  # B; 0: none, and weights stay what they are

    def begun(self, log_weight: float) -> Array:
        """(B,) replicates of a history before the first keyframe."""
        return np.full(self.num_replicates, log_weight)

    def grown(self, replicates: Array, keyframe: int, log_psi: float) -> Array:
        """(B,) replicates of a history after one keyframe more, whose weight it has multiplied by psi."""
        if self.num_replicates == 0:
            return replicates
        return np.asarray(replicates + _times(self.seed, self.num_replicates, keyframe) * log_psi)

    def log_weights(self, log_weights: Array, replicates: Array, kinds: Index) -> Array:
        """(H,) averaged between ``kinds`` (H,), from normalised ones (H,) and replicates (H, B)."""
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
    """(B,) how often each set has a keyframe."""
    return generator(seed, "bagging", 0, keyframe).poisson(1.0, num_replicates).astype(float)
