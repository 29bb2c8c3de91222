"""Gaussian priors of one variable, and of several with a joint covariance."""

from dataclasses import dataclass
from typing import Any

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.states.kinds.state_space import StateSpace


@dataclass(frozen=True)
class GaussianPrior:
    """Gaussian prior of a state, with the covariance in the tangent space at the mean."""

    mean: Array  # (s,)
    covariance: Array  # (d, d)
    anchor: Array | None = None  # (3,) origin of the ray if a point was first seen by its bearing alone, else None

    def at(self, mean: Array, robot: Array) -> "GaussianPrior":
        """The prior with the same covariance about another ``mean`` (s,); ``robot`` (s,) is not used here."""
        return GaussianPrior(mean, self.covariance)

    def factors(self, space: StateSpace, key: int) -> list[Any]:
        """GTSAM's factors of the prior."""
        return space.prior_factors(key, self.mean, self.covariance)


@dataclass(frozen=True)
class TwinPrior:
    """Prior of an object that another one would be if it had been moved: it is about that one, wherever that is."""

    object_id: int
    of: int  # id of the other object, which has the same mean
    covariance: Array  # (l, l) given the other, in the tangent space at the mean


@dataclass(frozen=True)
class JointPrior:
    """Joint covariance of the priors of n objects, in the tangent spaces at their means, and twins of some of them."""

    object_ids: tuple[int, ...]  # n
    covariance: Array  # (n l, n l)
    twins: tuple[TwinPrior, ...] = ()

    @property
    def every_id(self) -> frozenset[int]:
        """Ids of all objects whose prior it holds."""
        return frozenset(self.object_ids) | {twin.object_id for twin in self.twins}
