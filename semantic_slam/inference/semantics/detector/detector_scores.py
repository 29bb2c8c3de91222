"""Detector scores as evidence: a target of the detector, or a systematic mistake.

The log odds of scores are a mixture of two Gaussians, fitted by expectation-maximisation to the scores so far
(Dempster, Laird, Rubin 1977); the probability that there are two is decided by evidence, one Gaussian against two
(Schwarz's approximation). The component with the larger scores is the detector's target: it is seen from near and far,
so its scores spread no less than those of mistakes. The detector is doubtful of its mistakes: their mean odds are at
most three to one.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from semantic_slam.geometry.arrays import Array

LARGEST_LOG_ODDS = 20.0
"""Log odds of a score of 1, and minus those of 0."""
LEAST_SIGMA = 0.1
"""Least standard deviation of the log odds of a component."""
NUM_STEPS = 50
"""Steps of expectation-maximisation."""
LEAST_SCORES = 100.0
"""Number of effectively independent scores needed: those of a few objects look like two components, too."""
PARAMETERS_APART = 3.0
"""Number of parameters of two Gaussians and a share, minus those of one Gaussian."""
LARGEST_DOUBT = float(np.log(3.0))
"""Largest mean log odds of mistakes."""


def log_odds(scores: Array) -> Array:
    """(D,) log odds of scores (D,) in [0, 1]; NaN where the detector gives none."""
    with np.errstate(divide="ignore"):
        told = np.log(scores) - np.log1p(-scores)
    return np.asarray(np.clip(told, -LARGEST_LOG_ODDS, LARGEST_LOG_ODDS))


def moments_of(odds: Array) -> Array:
    """(D, 3) sufficient statistics for :meth:`ScoreKinds.log_ratio` of log odds (D,).

    These are number, sum and sum of squares; 0 where NaN.
    """
    told = np.isfinite(odds)
    known = np.where(told, odds, 0.0)
    return np.stack([told.astype(np.float64), known, known**2], axis=-1)


@dataclass(frozen=True, kw_only=True)
class ScoreKinds:
    """Gaussians of the log odds of scores, of mistakes and of targets."""

    shares: Array  # (2,)
    means: Array  # (2,)
    sigmas: Array  # (2,)
    probability: float  # that there are two components

    @classmethod
    def of(cls, odds: Array, weights: Array) -> Self | None:
        """Fitted to log odds (N,) with ``weights`` (N,); None where too few or too similar."""
        total = float(weights.sum())
        if total < LEAST_SCORES:
            return None
        mean = float(weights @ odds) / total
        variance = float(weights @ (odds - mean) ** 2) / total
        if variance <= LEAST_SIGMA**2:
            return None
        shares, sigmas = np.array([0.5, 0.5]), np.full(2, np.sqrt(variance))
        means = np.array([min(mean - sigmas[0], LARGEST_DOUBT), mean + sigmas[1]])
        for _ in range(NUM_STEPS):
            joint = _log_joint(odds, shares, means, sigmas)
            counts = weights * np.exp(joint - np.logaddexp.reduce(joint, axis=0))
            sums = np.maximum(counts.sum(axis=1), 1e-9)
            shares, means = sums / sums.sum(), counts @ odds / sums
            means[0] = min(means[0], LARGEST_DOUBT)
            spread = (counts * (odds - means[:, None]) ** 2).sum(axis=1) / sums
            if spread[0] > spread[1]:
                spread = np.full(2, shares @ spread)
            sigmas = np.sqrt(np.maximum(spread, LEAST_SIGMA**2))
        together = float(weights @ np.logaddexp.reduce(_log_joint(odds, shares, means, sigmas), axis=0))
        alone = -0.5 * total * (np.log(2.0 * np.pi * variance) + 1.0)
        gain = together - alone - 0.5 * PARAMETERS_APART * np.log(total)
        return cls(
            shares=shares,
            means=means,
            sigmas=sigmas,
            probability=float(1.0 / (1.0 + np.exp(-np.clip(gain, -700.0, 700.0)))),
        )

    def genuine(self, moments: Array) -> Array:
        """(...,) probabilities that objects are targets, from the ``moments`` (..., 3) of their scores.

        Moments are sums of :func:`moments_of`, each score weighed by its uncorrelated share. An object without any
        scores is genuine.
        """
        against = np.log(self.shares[0]) - np.log(self.shares[1]) - self.log_ratio(moments)
        genuine = 1.0 / (1.0 + np.exp(np.clip(against, -700.0, 700.0)))
        return np.asarray(np.where(moments[..., 0] > 0.0, 1.0 - self.probability * (1.0 - genuine), 1.0))

    def log_ratio(self, moments: Array) -> Array:
        """(...,) log ratio of the density of scores as of a target to that as of a mistake."""
        count, total, squared = np.moveaxis(moments, -1, 0)
        under = [
            -count * np.log(sigma) - 0.5 * (squared - 2.0 * mean * total + count * mean**2) / sigma**2
            for mean, sigma in zip(self.means, self.sigmas, strict=True)
        ]
        return np.asarray(under[1] - under[0])


def _log_joint(odds: Array, shares: Array, means: Array, sigmas: Array) -> Array:
    """(2, N) log densities of each component, with its share."""
    off = (odds - means[:, None]) / sigmas[:, None]
    return np.asarray(np.log(shares / sigmas)[:, None] - 0.5 * np.log(2.0 * np.pi) - 0.5 * off**2)
