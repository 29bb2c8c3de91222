"""Missed detections that come in runs: an object in view is detectable for a while, and then is not.

Detectability is a two-state Markov chain over keyframes: an object is detectable in a share pi of them, and its state
persists with correlation rho. A detectable object is detected with probability q, so that pi q is the configured
detection probability. Each hypothesis carries h, the probability that an object is detectable given that it exists:
the forward algorithm of a hidden Markov model beside the Bernoulli existence.
"""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags

HIT_PROBABILITY = 0.9
"""Detection probability q of a detectable object, unless the configured one is larger."""


@dataclass(frozen=True)
class MissRuns:
    """The Markov chain of detectability, of one sensor setting or of G."""

    detection_probability: float | Array  # pi q, the long-run average; (G,) for several settings
    persistence: float | Array  # rho, from one keyframe to the next; (G,) for several settings

    @property
    def hit(self) -> Array:
        """Detection probability q of a detectable object."""
        return np.maximum(HIT_PROBABILITY, self.detection_probability)

    @property
    def share(self) -> Array:
        """Share pi of the keyframes in which an object is detectable."""
        return np.asarray(self.detection_probability / self.hit)

    def next(self, detectable: Array) -> Array:
        """Predict (O,) or (O, G) probabilities of detectability to the next keyframe."""
        return np.asarray(self.share + self.persistence * (detectable - self.share))

    def after(self, detectable: Array, detected: Array, observed: Flags) -> Array:
        """Update: (O, G) probabilities h after a keyframe in which (O,) objects were ``observed`` (detected) or missed.

        ``detected`` (O, G) is their detection probability v q h, v being the probability of being in view.
        """
        missed = (detectable - detected) / np.maximum(1.0 - detected, 1e-12)
        return np.asarray(np.where(observed[:, None], 1.0, missed))

    def still_undetected(self, in_view: Array, gaps: Array) -> Array:
        """(N, G) probability of being undetected in L earlier looks and detectable now, relative to pi.

        It is the factor by which earlier misses make a first detection (birth) of each of N objects less likely.
        ``in_view`` (L, N, G) is the detection probability in each look relative to that at zero range; ``gaps`` (L, N)
        are the keyframes from each look to the next, from the last one to now. By the forward algorithm.
        """
        share = np.broadcast_to(self.share, in_view.shape[1:])
        seen, hidden = share.copy(), 1.0 - share  # joint with being detectable, or not detectable
        every = np.arange(gaps.max(initial=0) + 1)
        lasting = np.power(np.asarray(self.persistence, dtype=float), every[:, None])[gaps]
        for miss, left in zip(1.0 - self.hit * in_view, lasting, strict=True):
            missed = seen * miss
            total = missed + hidden
            settled = total * share
            seen = settled + left * (missed - settled)
            hidden = total - seen
        return np.asarray(seen / share)
