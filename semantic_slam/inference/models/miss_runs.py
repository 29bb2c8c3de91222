"""Misses that come in runs: an object in view is detectable for a while, and then is not.

Whether an object can be detected is a Markov chain of two states from keyframe to keyframe. It is detectable in a share
pi of them, and what it was persists with correlation rho; a detectable object is detected with probability q, so that
pi q is the configured detection probability. Each hypothesis carries h, the probability that an object is detectable
given that it exists: the forward algorithm of a hidden Markov model beside the Bernoulli of its existence.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags

HIT_PROBABILITY = 0.9
"""Detection probability of what is detectable, or the configured one where that is larger."""


@dataclass(frozen=True)
class MissRuns:
    """The chain of a sensor."""

    detection_probability: float  # pi q, in the long run
    persistence: float  # rho, from one keyframe to the next

    @property
    def hit(self) -> float:
        """Detection probability q of what is detectable."""
        return max(HIT_PROBABILITY, self.detection_probability)

    @property
    def share(self) -> float:
        """Share pi of the keyframes in which an object is detectable."""
        return self.detection_probability / self.hit

    def next(self, detectable: Array) -> Array:
        """(O,) probabilities one keyframe later."""
        return np.asarray(self.share + self.persistence * (detectable - self.share))

    def after(self, detectable: Array, detected: Array, observed: Flags) -> Array:
        """(O,) probabilities h after a keyframe in which objects were ``observed`` or not.

        ``detected`` (O,) is their detection probability v q h, v being that of being in view.
        """
        missed = (detectable - detected) / np.maximum(1.0 - detected, 1e-12)
        return np.asarray(np.where(observed, 1.0, missed))

    @cache  # noqa: B019  (a few sensors in a process)
    def _never(self, looks: int) -> tuple[float, float]:
        """Probabilities of no detection in so many looks, one a keyframe, and of then being detectable or not."""
        if looks == 0:
            return self.share, 1.0 - self.share
        seen, hidden = self._never(looks - 1)
        seen *= 1.0 - self.hit
        change = (1.0 - self.persistence) * np.array([1.0 - self.share, self.share])
        return seen * (1.0 - change[0]) + hidden * change[1], seen * change[0] + hidden * (1.0 - change[1])

    def never_detected(self, looks: int) -> float:
        """Probability that an object in view for so many keyframes was detected in none of them."""
        return float(sum(self._never(looks)))
