"""Configured noise of odometry on a motion."""

import numpy as np

from semantic_slam.configuration import OdometryConfiguration
from semantic_slam.geometry.arrays import Array


def odometry_covariance(travelled_m: float, turned_rad: float, noise: OdometryConfiguration) -> Array:
    """(3, 3) covariance over x, y, yaw at the end of a motion, from its path length and total rotation."""
    translation, rotation = odometry_variances(travelled_m, turned_rad, noise)
    return np.diag([translation, translation, rotation])


def odometry_variances(travelled_m: float, turned_rad: float, noise: OdometryConfiguration) -> tuple[float, float]:
    """Variances of translation and of rotation, equal for all axes.

    Those of independent causes add: floor, path length and turning.
    """
    translation = noise.sigma_translation_floor_m**2 + (noise.sigma_translation_per_m * travelled_m) ** 2
    rotation = (
        noise.sigma_rotation_floor_rad**2
        + (noise.sigma_rotation_per_m * travelled_m) ** 2
        + (noise.sigma_rotation_per_rad * turned_rad) ** 2
    )
    return translation, rotation
