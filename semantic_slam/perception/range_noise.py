"""Configured error of ranges that come without one, by depth images, disparities or a detector."""

import numpy as np

from semantic_slam.configuration import PerceptionConfiguration
from semantic_slam.geometry.arrays import Array


def range_variances(ranges_m: Array | float, settings: PerceptionConfiguration, cosines: Array | float = 1.0) -> Array:
    """(...,) variances [m^2] of ranges (...,) to objects' centres: constant, proportional, and by their square.

    The last is that of stereo and structured light: depth Z = f T / d errs by Z^2 / (f T) times the error of the
    disparity d. ``cosines`` (...,) of the angles between rays and the optical axis: the range Z / cosine, of the same
    share of error, errs by its square times the cosine.
    """
    ranges = np.asarray(ranges_m, dtype=np.float64)
    return np.asarray(
        settings.sigma_range_m**2
        + (settings.sigma_range_per_m * ranges) ** 2
        + (settings.sigma_range_per_m2 * cosines * ranges**2) ** 2
    )
