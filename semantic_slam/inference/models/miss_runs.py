"""Misses that come in runs: an object in view is detectable for a while, and then is not.

Whether an object can be detected is a Markov chain of two states from keyframe to keyframe. It is detectable in a share
pi of them, and what it was persists with correlation rho; a detectable object is detected with probability q, so that
pi q is the configured detection probability. Each hypothesis carries h, the probability that an object is detectable
given that it exists: the forward algorithm of a hidden Markov model beside the Bernoulli of its existence.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index

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

    def never_detected(self, looks: Index) -> Array:
        """(...,) probabilities that objects in view for so many keyframes (...,) were detected in none of them."""
        if self.persistence == 0.0:
            return np.asarray((1.0 - self.detection_probability) ** looks)
        return self._never(1 << int(looks.max(initial=0)).bit_length())[looks]

    @cache  # noqa: B019  (a few sensors in a process)
    def _never(self, count: int) -> Array:
        """(count,) probabilities of no detection in 0, 1, ... looks, one a keyframe."""
        found = np.ones(count)
        seen, hidden = self.share, 1.0 - self.share  # and of being detectable then, or not
        change = (1.0 - self.persistence) * np.array([1.0 - self.share, self.share])
        for looks in range(1, count):
            missed = seen * (1.0 - self.hit)
            found[looks] = missed + hidden
            seen, hidden = (
                missed * (1.0 - change[0]) + hidden * change[1],
                missed * change[0] + hidden * (1.0 - change[1]),
            )
        return found
