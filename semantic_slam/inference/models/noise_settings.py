"""What one hypothesis takes a robot's noises to be; evidence decides between hypotheses that differ in it."""

from dataclasses import dataclass
from itertools import product

from semantic_slam.configuration import Configuration

NAMES = {
    "odometry.noise_factor": "odometry_factor",
    "perception.noise_factor": "detection_factor",
}
"""Name in the configuration -> field of :class:`NoiseSettings`."""


@dataclass(frozen=True, kw_only=True)
class NoiseSettings:
    """Factors on covariances as they are told or configured."""

    odometry_factor: float = 1.0
    detection_factor: float = 1.0

    @classmethod
    def grid(cls, configuration: Configuration) -> "tuple[NoiseSettings, ...]":
        """Every combination that the configuration asks for."""
        factors = product(configuration.odometry.noise_factors, configuration.perception.noise_factors)
        return tuple(cls(odometry_factor=odometry, detection_factor=detection) for odometry, detection in factors)
