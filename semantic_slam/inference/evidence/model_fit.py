"""Monitoring of model fit ("unexplained"): the posterior probability of the null model over a window of keyframes.

Over a window of W keyframes either the belief explains all detections, or the null (reference) model replaces it from
some keyframe of the window on (a change point): each such keyframe has the prior ``PRIOR`` / W. With log ratios
r_i = log P_reference(Z_i) - log P(Z_i | Z_1:i-1) the posterior odds are
sum_j PRIOR / W exp(r_j + ... + r_k) to 1 - PRIOR n / W, n <= W being the keyframes that the window holds.
While the belief's model is right, E[exp(r)] <= 1, so that odds above one come about once in 1 / ``PRIOR`` windows at
most (Markov's inequality).
"""

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from semantic_slam.geometry.arrays import Array

WINDOW_KEYFRAMES = 10
"""Length of the window in keyframes: an older misfit is over, or is still visible in the window."""
UNEXPLAINED = 0.5
"""Probability above which the belief is reported as not explaining its data."""
PRIOR = 1e-3
"""Prior probability that the belief does not explain a window."""


def probability_unexplained(log_ratios: Array) -> float:
    """Posterior probability 0..1 that the null model replaces the belief from some keyframe of the window on.

    ``log_ratios`` (n,) in nats, newest last: log density of each keyframe's detections under the null model minus that
    under the belief. NaN if one of them is NaN.
    """
    if np.isnan(log_ratios).any():
        return np.nan
    hazard = PRIOR / WINDOW_KEYFRAMES
    since = np.cumsum(np.asarray(log_ratios)[::-1])
    log_odds = np.log(hazard) + np.logaddexp.reduce(since) - np.log1p(-hazard * len(since))
    return float(np.exp(log_odds - np.logaddexp(0.0, log_odds)))


@dataclass
class ModelFit:
    """Keeps the log ratios of a run's newest keyframes, and the probability that follows from them."""

    lately: deque[float] = field(default_factory=lambda: deque(maxlen=WINDOW_KEYFRAMES))
    unexplained: float = 0.0  # probability after the newest keyframe

    def add(self, log_evidence: float, log_reference: float) -> float:
        """Add a keyframe and return the probability that the belief does not explain its data.

        ``log_evidence`` and ``log_reference`` are log densities of its detections in the same units, in nats.
        """
        self.lately.append(log_reference - log_evidence)
        self.unexplained = probability_unexplained(np.array(self.lately))
        return self.unexplained


def mean_of_known(values: Array, weights: Array) -> float:
    """Mean of the (n,) values that are not NaN, by their weights (n,); NaN where none is known."""
    known = ~np.isnan(values)
    total = float(weights[known].sum())
    return float(weights[known] @ values[known]) / total if total > 0.0 else np.nan
