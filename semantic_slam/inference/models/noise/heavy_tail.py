"""Detections that err far more than the others: a share of them, in what does not repeat.

The place of a detection of a known object has the density (1 - e) N(0, R) + e N(0, F R). What repeats, a share s of R,
repeats in both: the white rest (1 - s) R of an outlier is (F - s) R. Of e there is a beta distribution: what a keyframe
takes it for is its mean after the keyframes before, each detection counting as an outlier by its probability.
"""

from dataclasses import dataclass

import numpy as np

from semantic_slam.configuration import DetectionErrorsConfiguration
from semantic_slam.inference.states.outlier_counts import OutlierCounts


@dataclass(frozen=True)
class HeavyTail:
    """How many detections are outliers in their place, and how wide these are."""

    share: float  # e
    width: float  # standard deviation of an outlier's white error, in those of others

    @classmethod
    def of(cls, settings: DetectionErrorsConfiguration, counts: OutlierCounts) -> "HeavyTail | None":
        """As configured, for a hypothesis that has had so many; None: no detection is an outlier."""
        if settings.outlier_share <= 0.0:
            return None
        repeated = settings.correlated_share
        width = float(np.sqrt((settings.outlier_factor - repeated) / (1.0 - repeated)))
        return cls(counts.share(settings.outlier_share, settings.outlier_counts), width)

    @property
    def added(self) -> float:
        """Variance of an outlier's white error beyond that of others, in their units."""
        return self.width**2 - 1.0

    @property
    def log_share(self) -> float:
        """Log probability that a detection is an outlier."""
        return float(np.log(self.share))

    @property
    def log_rest(self) -> float:
        """Log probability that it is none."""
        return float(np.log1p(-self.share))
