"""Configured error of ranges that come without one, by depth images, disparities or a detector."""

import numpy as np

from semantic_slam.configuration import PerceptionConfiguration
from semantic_slam.geometry.arrays import Array


def range_variances(ranges_m: Array | float, settings: PerceptionConfiguration) -> Array:
    """(...,) variances [m^2] of ranges (...,) to objects' centres: constant, proportional, and by their square.

    The last is that of stereo and structured light: depth Z = f T / d errs by Z^2 / (f T) times the error of the
    disparity d.
    """
    ranges = np.asarray(ranges_m, dtype=np.float64)
    return np.asarray(
        settings.sigma_range_m**2
        + (settings.sigma_range_per_m * ranges) ** 2
        + (settings.sigma_range_per_m2 * ranges**2) ** 2
    )
