"""Configured noise of odometry on a motion."""

import numpy as np

from semantic_slam.configuration import OdometryConfiguration
from semantic_slam.geometry.arrays import Array

OUT_OF_PLANE_FLOOR_M, OUT_OF_PLANE_FLOOR_RAD = 1e-4, 1e-5
"""Least standard deviations of z, and of roll and pitch, of a motion on wheels, which keep covariances invertible."""
TILT, HEIGHT = slice(3, 5), 2
"""Coordinates of a motion in space, x y z rx ry rz along and about the axes of the body, out of its plane."""


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


def odometry_covariance_in_space(
    travelled_m: float, turned_rad: float, noise: OdometryConfiguration, missing: tuple[float, float] = (0.0, 0.0)
) -> Array:
    """(6, 6) covariance over x y z rx ry rz at the end of a motion; equal for all axes but for a robot on wheels.

    ``missing``: additional variances [m^2, rad^2] where odometry was missing. What leaves the plane of a robot on
    wheels grows with the distance that it may have driven meanwhile.
    """
    translation, rotation = odometry_variances(travelled_m, turned_rad, noise)
    variances = np.repeat([translation + missing[0], rotation + missing[1]], 3)
    squared_m = travelled_m**2 + missing[0]
    if noise.sigma_out_of_plane_translation_per_m > 0.0:
        variances[HEIGHT] = OUT_OF_PLANE_FLOOR_M**2 + noise.sigma_out_of_plane_translation_per_m**2 * squared_m
    if noise.sigma_out_of_plane_rotation_per_m > 0.0:
        variances[TILT] = OUT_OF_PLANE_FLOOR_RAD**2 + noise.sigma_out_of_plane_rotation_per_m**2 * squared_m
    return np.diag(variances)
