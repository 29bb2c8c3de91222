"""The Gaussian prior of one variable, and of several that have errors in common."""

from dataclasses import dataclass

from semantic_slam.geometry.arrays import Array


@dataclass(frozen=True)
class GaussianPrior:
    """Covariance in the tangent space at the mean."""

    mean: Array  # (s,)
    covariance: Array  # (d, d)


@dataclass(frozen=True)
class JointPrior:
    """What the priors of n objects have in common: their covariance, in the tangent spaces at their means."""

    object_ids: tuple[int, ...]  # n
    covariance: Array  # (n l, n l)
