"""Chi-squared quantiles without scipy.stats, whose import costs every node half a second."""

import numpy as np
from numpy.typing import ArrayLike

from semantic_slam.geometry.arrays import Array


def chi_squared_quantile(share: ArrayLike, degrees: ArrayLike) -> Array:
    """Quantile of probability ``share`` for ``degrees`` degrees of freedom; NaN where these are NaN."""
    from scipy.special import gammaincinv  # deferred: the import is a third of a classifier's start time

    return np.asarray(2.0 * gammaincinv(0.5 * np.asarray(degrees, dtype=np.float64), share))
