"""What a detector's scores tell of what was seen little: a thing, or a false alarm.

What is a thing by all that places tell, whether it is there yet or has left, and what is none, show what scores things
and false alarms have: log odds that are Gaussian about two means and as wide about one as about the other. Each object
counts as one score, however often it was seen. Either mean leans on that of all, and how far there are two at all is
decided by evidence, that of one Gaussian against that of two (approximated by Schwarz). Where things that were seen
again and again have the scores of false alarms, scores tell nothing.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.special import expit

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.semantics.detector_scores import LEAST_SIGMA

LEANING = 3.0
"""Scores that the mean of all counts as, in that of things and in that of false alarms."""
PARAMETERS_APART = 1.0
"""Parameters of two Gaussians that are as wide as one another, less those of one."""


@dataclass(frozen=True, kw_only=True)
class AlarmScores:
    """Gaussians of the log odds of the scores of false alarms, and of things."""

    means: Array  # (2,) of false alarms, and of things
    variance: float  # of either
    probability: float  # that they are two

    @classmethod
    def of(cls, moments: Array, things: Array) -> Self | None:
        """What the scores of N objects show, given up ones among them; None where they tell nothing.

        ``moments`` (N, 3): sums of :func:`~semantic_slam.inference.semantics.detector_scores.moments_of`;
        ``things`` (N,): how likely each is a thing, as places have it.
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
        """(...,) how likely objects are things, by places (...,) and by the mean score of each, ``moments`` (..., 3).

        What has no score is as places have it.
        """
        count, total = moments[..., 0], moments[..., 1]
        has_score = count > 0.0
        mean = np.where(has_score, total, 0.0) / np.where(has_score, count, 1.0)
        log_ratio = (self.means[1] - self.means[0]) * (mean - self.means.mean()) / self.variance
        told = things / (things + (1.0 - things) * np.exp(-np.clip(log_ratio, -700.0, 700.0)))
        return np.where(has_score, self.probability * told + (1.0 - self.probability) * things, things)
