"""Marginal covariances of a smoother's variables, read from its iSAM2."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import gtsam
import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.smoothing.errors import LostComponentError
from semantic_slam.inference.smoothing.linear.located import Located
from semantic_slam.inference.smoothing.solver.elimination import MOST_JOINT
from semantic_slam.inference.smoothing.solver.isam import OwnedIsam
from semantic_slam.inference.states.keys import VECTOR_SIZES, is_descriptor, is_vector, letter_of
from semantic_slam.inference.states.spaces import Spaces

MOST_JOINT_SUMMARISED = 200
"""Number of states up to which one joint covariance costs less than single marginals where the past is marginalised, as
every single one then involves a clique of all objects. Otherwise that limit is MOST_JOINT."""


@dataclass(frozen=True, kw_only=True)
class MarginalReader:
    """Reads covariances in the tangent spaces at the estimates: r or l rows for a robot or object, L for a descriptor.

    Raises ConsumedSmootherError on every read once the iSAM2 has been handed on.
    """

    spaces: Spaces
    owned: OwnedIsam
    descriptor_size: int  # L
    last: tuple[int, ...]  # eliminated last
    is_summarised: bool  # the past is marginalised into one factor over all objects
    located: Callable[[], Located] | None  # estimates in charts, if iSAM2 holds charts; None: it holds states
    _known: dict[tuple[int, ...], Array] = field(default_factory=dict, compare=False, repr=False)

    def joint(self, keys: Sequence[int]) -> Array:
        """Joint marginal covariance in the order of ``keys``. Raises LostComponentError.

        Cached, as a report and the next prediction ask for the same. Whatever is asked of the states eliminated last is
        cut from their whole joint covariance, so that it is bitwise independent of earlier reads: a smoother that was
        rebuilt gives the same result as one that has reported all along.
        """
        _ = self.owned.isam  # raises where it was consumed
        whole = tuple(key for key in self.last if not is_descriptor(key))
        return self._part(whole, keys) if set(keys) <= set(whole) else self._whole(tuple(keys)).copy()

    def of_objects(self, keys: Sequence[int]) -> Array:
        """(n, l, l) marginal covariance of each object. Raises LostComponentError."""
        size = self.spaces.layout.landmark
        return np.array([self._own(key) for key in keys]).reshape(len(keys), size, size)

    def blocks(self, keys: Sequence[int]) -> Array:
        """(n, w, w) marginal covariances of a robot and objects; from the joint one if few. Raises LostComponentError.

        The next prediction asks for that joint covariance, too.
        """
        layout = self.spaces.layout
        if MOST_JOINT < len(keys) <= MOST_JOINT_SUMMARISED and self.is_summarised:
            return np.asarray(layout.diagonal(self._read(keys)[None])[0]).copy()  # predictions read what they ask for
        if len(keys) > MOST_JOINT:
            return layout.stacked_squares(self._own(keys[0]), self.of_objects(keys[1:]))
        blocks: Array = layout.diagonal(self.joint(keys)[None])[0].copy()
        return blocks

    def _whole(self, keys: tuple[int, ...]) -> Array:
        if keys not in self._known:
            self._known[keys] = self._read(keys)
        return self._known[keys]

    def _part(self, whole: tuple[int, ...], keys: Sequence[int]) -> Array:
        """Joint covariance of some ``keys``, cut from that of the ``whole``."""
        ends = np.cumsum([self._size(key) for key in whole])
        at = dict(zip(whole, ends, strict=True))
        rows = np.concatenate([np.arange(at[key] - self._size(key), at[key]) for key in keys])
        return np.asarray(self._whole(whole)[np.ix_(rows, rows)])

    def _read(self, wanted: Sequence[int]) -> Array:
        try:
            covariance = self.owned.isam.jointMarginalCovariance(list(wanted)).fullMatrix()
        except (RuntimeError, IndexError):
            covariance = self._by_qr(wanted)
        return self._at_estimates(wanted, 0.5 * (covariance + covariance.T))

    def _own(self, key: int) -> Array:
        try:
            covariance = self.owned.isam.marginalCovariance(key)
        except (RuntimeError, IndexError):
            covariance = self._by_qr([key])
        return self._at_estimates([key], covariance)

    def _by_qr(self, wanted: Sequence[int]) -> Array:
        """Covariance by QR of the whole graph, where its cliques are too poorly conditioned for Cholesky.

        So they may be where measurements far more precise than the rest contradict it. Raises LostComponentError where
        QR fails, too.
        """
        values = self.owned.isam.getLinearizationPoint()
        last, ordering = set(wanted), gtsam.Ordering()
        for key in [*(key for key in values.keys() if key not in last), *wanted]:  # noqa: SIM118
            ordering.push_back(key)
        jacobian: Array = self.owned.isam.getFactorsUnsafe().linearize(values).jacobian(ordering)[0]
        count = sum(self._size(key) for key in wanted)
        scale = np.linalg.norm(jacobian, axis=0)
        whole: Array = np.asarray(np.linalg.qr(jacobian / scale, mode="r"))
        if len(whole) < len(scale) or not np.abs(np.diag(whole)).min() > np.finfo(float).eps:
            raise LostComponentError("marginals are not to be had: the system is indeterminate")
        root = np.linalg.inv(whole[-count:, -count:]) / scale[-count:, None]  # of the wanted, eliminated last
        return np.asarray(root @ root.T)

    def _at_estimates(self, keys: Sequence[int], covariance: Array) -> Array:
        """A covariance of the ``keys`` transformed from iSAM2's charts to the tangent spaces at the estimates."""
        if self.located is None:
            return np.asarray(covariance)
        ends = np.cumsum([self._size(key) for key in keys]).tolist()
        parts = [(key, slice(end - self._size(key), end)) for key, end in zip(keys, ends, strict=True)]
        return self.located().covariance(parts, covariance)

    def _size(self, key: int) -> int:
        if is_vector(key):
            return VECTOR_SIZES[letter_of(key)]
        return self.descriptor_size if is_descriptor(key) else self.spaces.of(key).tangent_size
