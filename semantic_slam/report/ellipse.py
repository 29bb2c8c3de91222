"""The x-y part of a covariance as a picture shows it."""

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.pose import planar_from_covariance

Array = NDArray[np.float64]


def ellipse(covariance: Array) -> tuple[float, float, float]:
    """Semi-axes [m] of one standard deviation in x-y, direction [rad] of the first; (6, 6) in map. NaN stay NaN."""
    planar = planar_from_covariance(covariance)[:2, :2]
    if not np.isfinite(planar).all():
        return float("nan"), float("nan"), float("nan")
    values, vectors = np.linalg.eigh(planar)
    major, minor = np.sqrt(np.maximum(values[::-1], 0.0))
    return float(major), float(minor), float(np.arctan2(vectors[1, 1], vectors[0, 1]))
