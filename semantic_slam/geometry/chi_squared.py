"""Quantiles of the chi-squared distribution, without scipy.stats: its import takes every node half a second."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import gammaincinv

from semantic_slam.geometry.arrays import Array


def chi_squared_quantile(share: ArrayLike, degrees: ArrayLike) -> Array:
    """Below this lies so much of the distribution with so many degrees of freedom; NaN where these are NaN."""
    return np.asarray(2.0 * gammaincinv(0.5 * np.asarray(degrees, dtype=np.float64), share))
