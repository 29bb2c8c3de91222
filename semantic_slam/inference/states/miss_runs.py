"""Misses that come in runs: an object in view is detectable for a while, and then is not.

Whether an object can be detected is a Markov chain of two states from keyframe to keyframe. It is detectable in a share
pi of them, and what it was persists with correlation rho; a detectable object is detected with probability q, so that
pi q is the configured detection probability. Each hypothesis carries h, the probability that an object is detectable
given that it exists: the forward algorithm of a hidden Markov model beside the Bernoulli of its existence.
"""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags

HIT_PROBABILITY = 0.9
"""Detection probability of what is detectable, or the configured one where that is larger."""


@dataclass(frozen=True)
class MissRuns:
    """The chain of a sensor, or of each of G."""

    detection_probability: float | Array  # pi q, in the long run; (G,) of several
    persistence: float | Array  # rho, from one keyframe to the next; (G,) of several

    @property
    def hit(self) -> Array:
        """Detection probability q of what is detectable."""
        return np.maximum(HIT_PROBABILITY, self.detection_probability)

    @property
    def share(self) -> Array:
        """Share pi of the keyframes in which an object is detectable."""
        return np.asarray(self.detection_probability / self.hit)

    def next(self, detectable: Array) -> Array:
        """(O,) or (O, G) probabilities one keyframe later."""
        return np.asarray(self.share + self.persistence * (detectable - self.share))

    def after(self, detectable: Array, detected: Array, observed: Flags) -> Array:
        """(O, G) probabilities h after a keyframe in which (O,) objects were ``observed`` or not.

        ``detected`` (O, G) is their detection probability v q h, v being that of being in view.
        """
        missed = (detectable - detected) / np.maximum(1.0 - detected, 1e-12)
        return np.asarray(np.where(observed[:, None], 1.0, missed))

    def still_undetected(self, in_view: Array, gaps: Array) -> Array:
        """(N, G) how much less likely than without earlier looks it is that objects are detected first now.

        Each of N objects was looked at (L, N) times and never detected: ``in_view`` (L, N, G) is the probability of
        its detection in each look, relative to that of one right at the sensor, ``gaps`` (L, N) the keyframes from
        there to the next look, and to now from the last. The forward algorithm, over both states.
        """
        share = np.broadcast_to(self.share, in_view.shape[1:])
        seen, hidden = share.copy(), 1.0 - share  # and of being detectable then, or not
        lasting = np.power(np.asarray(self.persistence, dtype=float), gaps[..., None])
        for chance, left in zip(self.hit * in_view, lasting, strict=True):
            missed = seen * (1.0 - chance)
            total = missed + hidden
            seen = total * share + left * (missed - total * share)
            hidden = total - seen
        return np.asarray(seen / share)
