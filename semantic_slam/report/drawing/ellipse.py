"""Ellipses of the x-y part of covariances, for drawing."""

import numpy as np

from semantic_slam.geometry.arrays import Array


def ellipses(covariances: Array) -> Array:
    """(N, 3) semi-axes [m] of one standard deviation in x-y, major first, and the major one's direction [rad].

    ``covariances`` is (N, 6, 6) or (N, 3, 3) in map; [[a, b], [b, c]] has eigenvalues
    (a + c) / 2 +- sqrt(((a - c) / 2)^2 + b^2).
    """
    a, b, c = covariances[:, 0, 0], covariances[:, 0, 1], covariances[:, 1, 1]
    middle, radius = (a + c) / 2.0, np.hypot((a - c) / 2.0, b)
    major, minor = np.sqrt(np.maximum(middle + radius, 0.0)), np.sqrt(np.maximum(middle - radius, 0.0))
    return np.stack([major, minor, 0.5 * np.arctan2(2.0 * b, a - c)], axis=1)
