"""Which combinations of features tell most: signal against noise, noise made white (so that Sigma may be diagonal)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Axes:
    """f' = matrix @ (f - offset)."""

    matrix: Array  # (F', F)
    offset: Array  # (F,)


def informative_axes(means: Array, residuals: Array, count: int) -> Axes:
    """The ``count`` axes along which the (N, F) predicted means vary most in units of the (M, F) residuals' spread.

    Along them the residuals are uncorrelated and of unit spread.
    """
    offset = means.mean(axis=0)
    signal = np.cov(means - offset, rowvar=False)
    noise = residuals.T @ residuals / len(residuals)
    noise += 1e-4 * np.trace(noise) / len(noise) * np.eye(len(noise))
    _, vectors = eigh(signal, noise)
    return Axes(vectors[:, ::-1][:, :count].T.copy(), offset)
