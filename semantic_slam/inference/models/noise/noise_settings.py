"""Noise settings that one hypothesis assumes for a robot's sensors; evidence decides between hypotheses."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from semantic_slam.configuration import Configuration, DetectionErrorsConfiguration
from semantic_slam.geometry.arrays import Array

NAMES = {
    "odometry.noise_factor": "odometry_factor",
    "perception.noise_factor": "detection_factor",
    "perception.ranges_are_depth": "ranges_are_depth",
    "detection_errors.correlated_share": "correlated_share",
}
"""Name in the configuration -> field of :class:`NoiseSettings`."""
DISTANCE, DEPTH = "distance", "depth"
"""Meaning of a detection's range: distance to the object, or depth along the sensor's axis."""
VERY_STRONG = 150.0
"""Prior odds against odometry that is better than configured, "very strong" evidence (Kass and Raftery 1995).  Odometry
assumed better than it is makes a belief overconfident; assumed worse, only less certain."""


@dataclass(frozen=True, kw_only=True)
class NoiseSettings:
    """Factors on the given or configured covariances, the meaning of ranges, and what of detection errors repeats."""

    odometry_factor: float = 1.0
    detection_factor: float = 1.0
    ranges_are_depth: bool = False
    axis_rad: float = 0.0  # bearing in the body frame along which a depth is measured
    correlated_share: float | None = None  # of the variance of a detection's place; None: as configured

    @property
    def as_told(self) -> bool:
        """Whether detections are used as given."""
        return self.detection_factor == 1.0 and not self.ranges_are_depth

    @property
    def log_prior(self) -> float:
        """Log prior weight, up to a constant."""
        return -float(np.log(VERY_STRONG)) if self.odometry_factor < 1.0 else 0.0

    @classmethod
    def grid(cls, configuration: Configuration) -> "tuple[NoiseSettings, ...]":
        """Every combination that the configuration asks for."""
        perception, axis = configuration.perception, configuration.open_world.direction_rad
        shares: Sequence[float | None] = configuration.detection_errors.correlated_shares or (None,)
        factors = product(perception.ranges_are, configuration.odometry.noise_factors, perception.noise_factors, shares)
        return tuple(
            cls(
                odometry_factor=odometry,
                detection_factor=detection,
                ranges_are_depth=kind == DEPTH,
                axis_rad=axis,
                correlated_share=share,
            )
            for kind, odometry, detection, share in factors
        )


def errors_under(
    settings: NoiseSettings | None, configured: DetectionErrorsConfiguration
) -> DetectionErrorsConfiguration:
    """What a hypothesis with ``settings`` takes detection errors to be."""
    if settings is None or settings.correlated_share is None:
        return configured
    return replace(configured, correlated_share=settings.correlated_share)


def shares_of_odometry(factors: Sequence[float]) -> Array:
    """(n,) prior probabilities of ``factors`` (n,) on the covariance of odometry."""
    weights = np.exp([NoiseSettings(odometry_factor=own).log_prior for own in factors])
    return np.asarray(weights / weights.sum())
