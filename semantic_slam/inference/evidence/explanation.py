"""Whether the belief still explains its data: the posterior of a reference model that expects nothing.

Over a window of W keyframes the belief either explains all detections, or explains none from some keyframe of the
window on: each such beginning has the prior ``PRIOR`` / W, and from there on the reference tells the density of the
detections. With log ratios r_i = log P_reference(Z_i) - log P(Z_i | Z_1:i-1) the posterior odds are
sum_j PRIOR / W exp(r_j + ... + r_k) to 1 - PRIOR n / W, n <= W being the keyframes that the window holds.
While the belief's model is right, E[exp(r)] <= 1, so that odds above one come about once in 1 / ``PRIOR`` windows at
most (Markov's inequality).
"""

from collections import deque
from dataclasses import dataclass, field

import numpy as np

from semantic_slam.geometry.arrays import Array

WINDOW_KEYFRAMES = 10
"""Keyframes of the window: a misfit longer ago than that is over, or goes on."""
UNEXPLAINED = 0.5
"""Probability from which on the belief is said not to explain its data."""
PRIOR = 1e-3
"""Prior probability of a window that the belief does not explain."""


def probability_unexplained(log_ratios: Array) -> float:
    """Posterior 0..1 that the belief explains nothing from some keyframe of the window on.

    ``log_ratios`` (n,) in nats, newest last: log density of each keyframe's detections under the reference, less that
    under the belief. NaN where one of them is unknown.
    """
    if np.isnan(log_ratios).any():
        return np.nan
    hazard = PRIOR / WINDOW_KEYFRAMES
    since = np.cumsum(np.asarray(log_ratios)[::-1])
    log_odds = np.log(hazard) + np.logaddexp.reduce(since) - np.log1p(-hazard * len(since))
    return float(np.exp(log_odds - np.logaddexp(0.0, log_odds)))


@dataclass
class Explanation:
    """Holds the log ratios of the newest keyframes of a run."""

    lately: deque[float] = field(default_factory=lambda: deque(maxlen=WINDOW_KEYFRAMES))
    unexplained: float = 0.0  # probability after the newest keyframe

    def add(self, log_evidence: float, log_reference: float) -> float:
        """Probability that the belief does not explain its data, with one more keyframe.

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
