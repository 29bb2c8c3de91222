"""Outlier model of detection positions: a share of detections has a far larger white error.

The position of a detection of a known object has the density (1 - e) N(0, R) + e N(0, F R). The correlated error, a
share s of R, is the same in both: the white part (1 - s) R becomes (F - s) R in an outlier. e has a beta distribution:
a keyframe uses its mean after the keyframes before, each detection counting as an outlier by its posterior probability.
"""

from dataclasses import dataclass

import numpy as np

from semantic_slam.configuration import DetectionErrorsConfiguration
from semantic_slam.inference.models.correlated_errors import share_of
from semantic_slam.inference.states.outlier_counts import OutlierCounts


@dataclass(frozen=True)
class HeavyTail:
    """Share of detections with outlying positions, and their width."""

    share: float  # e
    width: float  # standard deviation of an outlier's white error relative to an inlier's

    @classmethod
    def of(cls, settings: DetectionErrorsConfiguration, counts: OutlierCounts) -> "HeavyTail | None":
        """Under what a hypothesis takes errors to be, updated by its ``counts``; None: no detection is an outlier."""
        if settings.outlier_share <= 0.0:
            return None
        repeated = share_of(settings)
        width = float(np.sqrt((settings.outlier_factor - repeated) / (1.0 - repeated)))
        return cls(counts.share(settings.outlier_share, settings.outlier_counts), width)

    @property
    def added(self) -> float:
        """Excess variance of an outlier's white error, in units of an inlier's."""
        return self.width**2 - 1.0

    @property
    def log_share(self) -> float:
        """Log probability that a detection is an outlier."""
        return float(np.log(self.share))

    @property
    def log_rest(self) -> float:
        """Log probability that a detection is an inlier."""
        return float(np.log1p(-self.share))
