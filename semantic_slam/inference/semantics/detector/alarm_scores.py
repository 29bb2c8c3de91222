"""Detector scores as evidence for rarely seen objects: real thing or false alarm.

The objects that positions show to be things, present or departed, and those they show to be none, give the score
distributions of both: Gaussian log odds with two means and a common variance. Each object counts as one score, however
often it was seen. Both means are shrunk to the common mean, and the probability that there are two is decided by
evidence, one Gaussian against two (Schwarz's approximation). Where things that were seen repeatedly have the scores of
false alarms, scores are uninformative.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.special import expit

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.semantics.detector.detector_scores import LEAST_SIGMA

LEANING = 3.0
"""Number of scores that the common mean counts as, in the means of things and of false alarms."""
PARAMETERS_APART = 1.0
"""Number of parameters of two Gaussians with a common variance, minus those of one."""


@dataclass(frozen=True, kw_only=True)
class AlarmScores:
    """Gaussians of the log odds of scores, of false alarms and of things."""

    means: Array  # (2,) of false alarms, and of things
    variance: float  # of either
    probability: float  # that the two differ

    @classmethod
    def of(cls, moments: Array, things: Array) -> Self | None:
        """Fitted to the scores of N objects, including dropped ones; None where they are uninformative.

        ``moments`` (N, 3): sums of
        :func:`~semantic_slam.inference.semantics.detector.detector_scores.moments_of`; ``things`` (N,): the probability
        that each is a thing, by positions.
        """
        each = moments / np.maximum(moments[:, :1], np.finfo(float).tiny)
        count, total, squared = each.sum(axis=0)
        if count <= 0.0 or squared / count - (total / count) ** 2 <= LEAST_SIGMA**2:
            return None
        mean = total / count
        counts, totals = (np.stack([1.0 - things, things]) @ each[:, :2]).T
        means = (totals + LEANING * mean) / (counts + LEANING)
        if means[0] >= means[1]:
            return None
        within = squared + float(means @ (counts * means - 2.0 * totals))
        alone = squared - count * mean**2
        variance = max(within / count, LEAST_SIGMA**2)
        gain = 0.5 * (count * np.log(alone / (count * variance)) - PARAMETERS_APART * np.log(count))
        return cls(means=means, variance=variance, probability=float(expit(gain)))

    def weighed(self, things: Array, moments: Array) -> Array:
        """(...,) probability that objects are things, by positions (...,) and mean scores, ``moments`` (..., 3).

        Objects without a score keep the probability by positions.
        """
        count, total = moments[..., 0], moments[..., 1]
        has_score = count > 0.0
        mean = np.where(has_score, total, 0.0) / np.where(has_score, count, 1.0)
        log_ratio = (self.means[1] - self.means[0]) * (mean - self.means.mean()) / self.variance
        told = things / (things + (1.0 - things) * np.exp(-np.clip(log_ratio, -700.0, 700.0)))
        return np.where(has_score, self.probability * told + (1.0 - self.probability) * things, things)
