"""What one hypothesis takes a robot's sensors to be; evidence decides between hypotheses that differ in it."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from semantic_slam.configuration import Configuration
from semantic_slam.geometry.arrays import Array

NAMES = {
    "odometry.noise_factor": "odometry_factor",
    "perception.noise_factor": "detection_factor",
    "perception.ranges_are_depth": "ranges_are_depth",
}
"""Name in the configuration -> field of :class:`NoiseSettings`."""
DISTANCE, DEPTH = "distance", "depth"
"""What a detection's range may be: to the object, or along the sensor's axis alone."""
VERY_STRONG = 150.0
"""Odds by which evidence has to speak for odometry that is better than configured (Kass and Raftery 1995).

Taken to be better than it is, it makes a belief sure of what is wrong; taken to be worse, only less sure.
"""


@dataclass(frozen=True, kw_only=True)
class NoiseSettings:
    """Factors on covariances as they are told or configured, and what the ranges of detections are."""

    odometry_factor: float = 1.0
    detection_factor: float = 1.0
    ranges_are_depth: bool = False
    axis_rad: float = 0.0  # bearing in the body frame along which a depth is measured

    @property
    def as_told(self) -> bool:
        """Whether detections are taken as they are told."""
        return self.detection_factor == 1.0 and not self.ranges_are_depth

    @property
    def log_prior(self) -> float:
        """Log weight before any measurement, up to what is the same for all settings."""
        return -float(np.log(VERY_STRONG)) if self.odometry_factor < 1.0 else 0.0

    @classmethod
    def grid(cls, configuration: Configuration) -> "tuple[NoiseSettings, ...]":
        """Every combination that the configuration asks for."""
        perception, axis = configuration.perception, configuration.open_world.direction_rad
        factors = product(perception.ranges_are, configuration.odometry.noise_factors, perception.noise_factors)
        return tuple(
            cls(odometry_factor=odometry, detection_factor=detection, ranges_are_depth=kind == DEPTH, axis_rad=axis)
            for kind, odometry, detection in factors
        )


def shares_of_odometry(factors: Sequence[float]) -> Array:
    """(n,) probabilities of ``factors`` (n,) on the covariance of odometry before any measurement."""
    weights = np.exp([NoiseSettings(odometry_factor=own).log_prior for own in factors])
    return np.asarray(weights / weights.sum())
