"""Where the map has its objects: positions and their joint covariance, as the prior factors of a run hold it."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.models.joint_prior import as_factors_say
from semantic_slam.inference.states.gaussian import JointPrior
from semantic_slam.inference.states.kinds.state_space import StateSpace
from semantic_slam.inference.world.objects import ObjectEntry

MOST_CONTEXT = 40
"""Number of objects up to which some and those nearest to them stand for the whole map, which has errors in common."""


@dataclass(frozen=True, kw_only=True)
class PlacesOnMap:
    """Positions (d coordinates) of n mapped objects."""

    ids: tuple[int, ...]  # n
    means: Array  # (n, d) metres
    own: Array  # (n, d, d) covariances of each by itself
    joint: Array | None  # (n d, n d); None: independent

    @classmethod
    def of(cls, landmark: StateSpace, entries: Sequence[ObjectEntry], joint: JointPrior | None) -> "PlacesOnMap":
        """The places of some objects of the map: all of those that the joint prior is of, if there is one."""
        states = np.array([entry.prior.mean for entry in entries])
        slopes = landmark.position_slopes(states)
        own = slopes @ np.array([entry.prior.covariance for entry in entries]) @ np.swapaxes(slopes, 1, 2)
        together = None if joint is None else _along_map(slopes, as_factors_say(joint.covariance, len(entries)))
        return cls(
            ids=tuple(entry.object_id for entry in entries),
            means=landmark.position(states),
            own=own,
            joint=together,
        )

    def distances(self, offsets: Array) -> Array:
        """(n,) Mahalanobis distances of places that are ``offsets`` (n, d) off, each given where all others are."""
        scores = self._scores(offsets)
        return np.asarray(np.sqrt(np.einsum("ni,nij,nj->n", scores, np.linalg.inv(self._precisions), scores)))

    def context(self, rows: Index) -> Index:
        """Rows of the objects to be weighed jointly with ``rows``: these first, then those nearest to them."""
        if self.joint is None:
            return rows
        away = np.linalg.norm(self.means[:, None] - self.means[rows], axis=-1).min(axis=1)
        others = np.setdiff1d(np.argsort(away, kind="stable")[:MOST_CONTEXT], rows)
        return np.concatenate([rows, others])

    def covariance(self, rows: Index) -> Array:
        """(m d, m d) joint covariance of some objects."""
        size = self.means.shape[1]
        if self.joint is None:
            found = np.zeros((len(rows), size, len(rows), size))
            each = np.arange(len(rows))
            found[each, :, each] = self.own[rows]
            return found.reshape(len(rows) * size, -1)
        places = (size * rows[:, None] + np.arange(size)).ravel()
        return np.asarray(self.joint[np.ix_(places, places)])

    def _scores(self, offsets: Array) -> Array:
        """(n, d) offsets times the joint precision."""
        if self.joint is None:
            return (self._precisions @ offsets[..., None])[..., 0]
        return (self._precision @ offsets.ravel()).reshape(offsets.shape)

    @cached_property
    def _precision(self) -> Array:
        """(n d, n d) inverse of the joint covariance."""
        assert self.joint is not None
        return np.asarray(np.linalg.inv(self.joint))

    @cached_property
    def _precisions(self) -> Array:
        """(n, d, d) precision of each object given all others."""
        if self.joint is None:
            return np.asarray(np.linalg.inv(self.own))
        (count, size), each = self.means.shape, np.arange(len(self.means))
        return np.asarray(self._precision.reshape(count, size, count, size)[each, :, each])


def _along_map(slopes: Array, covariance: Array) -> Array:
    """(n d, n d) covariance of positions along the axes of map, from one (n l, n l) of states."""
    count, size, tangent = slopes.shape
    blocks = covariance.reshape(count, tangent, count, tangent)
    turned = np.einsum("aip,apbq,bjq->aibj", slopes, blocks, slopes)
    return np.asarray(turned.reshape(count * size, count * size))
