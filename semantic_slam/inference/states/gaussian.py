"""The Gaussian prior of one variable, and of several that have errors in common."""

from dataclasses import dataclass
from typing import Any

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.states.kinds.state_space import StateSpace


@dataclass(frozen=True)
class GaussianPrior:
    """Covariance in the tangent space at the mean."""

    mean: Array  # (s,)
    covariance: Array  # (d, d)
    anchor: Array | None = None  # (3,) from where a point was seen along a ray alone; None: more was known of it

    def at(self, mean: Array, robot: Array) -> "GaussianPrior":
        """As wide about another ``mean`` (s,), seen from another ``robot`` (s,)."""
        return GaussianPrior(mean, self.covariance)

    def factor(self, space: StateSpace, key: int) -> Any:
        """GTSAM's factor of it."""
        return space.prior_factor(key, self.mean, self.covariance)


@dataclass(frozen=True)
class JointPrior:
    """What the priors of n objects have in common: their covariance, in the tangent spaces at their means."""

    object_ids: tuple[int, ...]  # n
    covariance: Array  # (n l, n l)
