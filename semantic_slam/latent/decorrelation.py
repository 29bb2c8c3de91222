"""Axes of the features along which what the model leaves unexplained is uncorrelated, so that Sigma may be diagonal."""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

Array = NDArray[np.float64]

RIDGE = 1e-6
"""Share of the residuals' mean variance that is added to every axis."""


def decorrelating(first: Array, second: Array) -> Array:
    """(F, F) matrix after which (N, F) residuals of two kinds are both uncorrelated, the first of unit spread."""
    covariances = [residuals.T @ residuals / len(residuals) for residuals in (first, second)]
    ridge = RIDGE * np.trace(covariances[0]) / len(covariances[0]) * np.eye(len(covariances[0]))
    _, vectors = eigh(covariances[1], covariances[0] + ridge)
    return np.asarray(vectors.T)
