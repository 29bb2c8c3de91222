"""The Gaussian prior of one variable."""

from dataclasses import dataclass

from semantic_slam.geometry.arrays import Array


@dataclass(frozen=True)
class GaussianPrior:
    """Covariance in the tangent space at the mean."""

    mean: Array  # (s,)
    covariance: Array  # (d, d)
