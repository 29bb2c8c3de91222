"""What one hypothesis takes a robot's noises to be; evidence decides between hypotheses that differ in it."""

from dataclasses import dataclass
from itertools import product

from semantic_slam.configuration import Configuration

NAMES = {
    "odometry.noise_factor": "odometry_factor",
    "perception.noise_factor": "detection_factor",
    "open_world.detection_probability": "detection_probability",
    "open_world.birth_density": "birth_density",
}
"""Name in the configuration -> field of :class:`NoiseSettings`."""


@dataclass(frozen=True, kw_only=True)
class NoiseSettings:
    """Factors on covariances as they are told or configured, and what is to be detected, how often."""

    odometry_factor: float = 1.0
    detection_factor: float = 1.0
    detection_probability: float
    birth_density: float  # objects per square metre

    @classmethod
    def grid(cls, configuration: Configuration) -> "tuple[NoiseSettings, ...]":
        """Every combination that the configuration asks for."""
        world = configuration.open_world
        return tuple(
            cls(
                odometry_factor=odometry,
                detection_factor=detection,
                detection_probability=probability,
                birth_density=density,
            )
            for odometry, detection, probability, density in product(
                configuration.odometry.noise_factors,
                configuration.perception.noise_factors,
                world.detection_probabilities or (world.detection_probability,),
                world.birth_densities or (world.birth_density,),
            )
        )
