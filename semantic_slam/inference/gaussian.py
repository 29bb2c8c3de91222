"""The Gaussian prior of one variable."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GaussianPrior:
    """Covariance in the tangent space at the mean."""

    mean: Array  # (d,)
    covariance: Array  # (d, d)
