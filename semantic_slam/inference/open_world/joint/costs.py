"""Joint association costs: the weight of a detection as of each object, given the associations of the others.

All candidate pairs of a frame have one joint innovation, correlated through the robot, the objects and shared detection
errors. Most of it is the robot's pose error, which the other detections determine better than the prediction does:
given them, the remaining ambiguity is one of single detections.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index, broadcast_copy
from semantic_slam.geometry.small_matrices import cholesky, forward
from semantic_slam.inference.evidence.outlier_choices import OutlierChoices, likeliest_outliers
from semantic_slam.inference.models.noise.heavy_tail import HeavyTail
from semantic_slam.inference.open_world.joint.all_but_some import given_all_but
from semantic_slam.inference.open_world.joint.linear_evidence import LinearisedEvidence
from semantic_slam.inference.open_world.joint.log_gaussian import log_gaussian, log_gaussian_of_many


@dataclass(frozen=True, kw_only=True)
class JointCosts:
    """P pairs of D detections and M objects under one Gaussian of their whitened residuals, c components each.

    A detection of none of these objects has an independent weight, in T ways, the last of which is no known object.
    """

    rows: Index  # (P,) detection
    columns: Index  # (P,) object
    residual: Array  # (P, c)
    covariance: Array  # (P, P, c, c)
    log_constant: Array  # (P,) normaliser, and log ratio of detecting the object to missing it
    log_alone: Array  # (D, T)
    num_objects: int  # M
    tail: HeavyTail | None  # of detections' errors; None: none is an outlier
    measured: Flags  # (P, c) which components of the residuals there are

    @classmethod
    def of(cls, linear: LinearisedEvidence, admitted: Flags, log_ratio: Array, log_alone: Array) -> "JointCosts":
        """Costs of the ``admitted`` (D, M) pairs; ``log_ratio`` (M,) of detecting an object to missing it.

        ``log_ratio`` may be (D, M), with further evidence of each pair.
        """
        rows, columns = np.nonzero(admitted)
        joint, count = linear.innovation_of_pairs(rows, columns), len(rows)
        size = len(joint.residual) // max(count, 1)
        return cls(
            rows=rows,
            columns=columns,
            residual=joint.residual.reshape(count, size),
            covariance=np.swapaxes(joint.covariance.reshape(count, size, count, size), 1, 2),
            log_constant=joint.log_normalisers + np.broadcast_to(log_ratio, admitted.shape)[rows, columns],
            log_alone=log_alone,
            num_objects=admitted.shape[1],
            tail=linear.tail,
            measured=joint.measured.reshape(count, size),
        )

    def log_scores(self, assignments: Index) -> Array:
        """(K,) log weights of joint assignments (K, D): objects, and from M on the ways of being none of them."""
        pairs = self._pairs(assignments)
        ways = np.clip(assignments - self.num_objects, 0, self.log_alone.shape[1] - 1)
        alone = self.log_alone[np.arange(len(self.log_alone)), ways]
        constant = np.where(pairs >= 0, self.log_constant[pairs], alone).sum(axis=1)
        residual, covariance = self._joint(pairs)
        if self.tail is not None:
            choices = OutlierChoices.of(self.tail, residual, covariance, self._told(pairs))
            return np.asarray(constant + choices.log_density)
        squared = (residual * np.linalg.solve(covariance, residual[..., None])[..., 0]).sum(axis=1)
        return np.asarray(constant - 0.5 * squared - 0.5 * np.linalg.slogdet(covariance)[1])

    def _outliers(self, pairs: Index) -> Flags:
        """(K, n) which of ``pairs`` (K, n) are outliers."""
        if self.tail is None:
            return np.zeros(pairs.shape, dtype=bool)
        return likeliest_outliers(self.tail, *self._joint(pairs), self._told(pairs))

    def _told(self, pairs: Index) -> Flags:
        """(K, n, c) which residual components of ``pairs`` (K, n) are measured."""
        return np.asarray(self.measured[pairs] & (pairs >= 0)[..., None])

    def given_others(self, assignment: Index) -> Array:
        """(D, M) log weight of each pair given the other detections of the joint ``assignment`` (D,); -inf: no pair.

        Only others of another object count: differences equal those of :meth:`log_scores` between assignments that
        differ in one detection.
        """
        taken = self._pairs(assignment[None])
        residual, covariance = (own[0] for own in self._joint(taken))
        if self.tail is not None:
            added = (self.tail.added * (self._outliers(taken) & (taken >= 0)))[..., None] * self.measured[taken]
            covariance[np.arange(len(residual)), np.arange(len(residual))] += added.ravel()
        count, size = self.residual.shape
        cross = np.where((taken >= 0)[..., None, None], self.covariance[np.arange(count)[:, None], taken], 0.0)
        cross = np.swapaxes(cross, 1, 2).reshape(count, size, -1)
        shift, known = given_all_but(residual, covariance, cross, self._excluded(taken[0]))
        left, spread = self.residual - shift, self._alone - known
        values = self.log_constant + self._log_density(np.arange(count), left, spread, log_gaussian)
        return self._table(np.asarray(values))

    def _excluded(self, taken: Index) -> Index:
        """(P, 2) detections that do not count for each pair: its own one, and that of its object; -1: none.

        ``taken`` (D,) are the pairs of a joint assignment, or -1.
        """
        holder = np.full(self.num_objects, -1)
        of_objects = np.flatnonzero(taken >= 0)
        holder[self.columns[taken[of_objects]]] = of_objects
        other = holder[self.columns]
        return np.stack([self.rows, np.where(other == self.rows, -1, other)], axis=1)

    def given_each(self, each: Index) -> Array:
        """(n, D, M) log weight of each pair given one of the pairs ``each`` (n,); -inf: no pair, or excluded by it.

        The given pair has weight 1 (0 nats).
        """
        root = cholesky(self._alone[each])
        cross = forward(root[:, None], self.covariance[each])  # of the first pair, whitened, with the second
        white = forward(root, self.residual[each, :, None])
        left, spread = broadcast_copy(self.residual, cross.shape[:3]), broadcast_copy(self._alone, cross.shape)
        for component in range(cross.shape[2]):
            own = cross[:, :, component]
            left -= own * white[:, None, component]
            spread -= own[..., :, None] * own[..., None, :]
        possible = (self.rows[each, None] != self.rows) & (self.columns[each, None] != self.columns)
        second = np.nonzero(possible)[1]
        values = np.full(possible.shape, -np.inf)
        values[possible] = self.log_constant[second] + self._log_density(
            second, left[possible], spread[possible], log_gaussian_of_many
        )
        values[np.arange(len(each)), each] = 0.0
        return self._table(values)

    @cached_property
    def _alone(self) -> Array:
        """(P, c, c) innovation covariance of each pair by itself."""
        pairs = np.arange(len(self.rows))
        return np.asarray(self.covariance[pairs, pairs])

    def _log_density(
        self,
        pairs: Index,
        residual: Array,
        covariance: Array,
        log_gaussian: Callable[[Array, Array], Array],
    ) -> Array:
        """(K,) log densities of single ``pairs`` (K,), without the constant normaliser of whitened residuals (K, c)."""
        log_density = log_gaussian(residual, covariance)
        if self.tail is None:
            return log_density
        wide = covariance + (self.tail.added * self.measured[pairs])[..., None] * np.eye(residual.shape[1])
        return np.logaddexp(self.tail.log_rest + log_density, self.tail.log_share + log_gaussian(residual, wide))

    def _joint(self, pairs: Index) -> tuple[Array, Array]:
        """(K, n c) residuals and their covariances for ``pairs`` (K, n); identity in place of -1."""
        count, size = self.residual.shape
        own = np.where(pairs >= 0, pairs, count + np.arange(pairs.shape[1]))
        rows = (size * own[..., None] + np.arange(size)).reshape(len(pairs), -1)
        residual, covariance = self._with_none
        return residual[rows], covariance[rows[:, :, None], rows[:, None, :]]

    @cached_property
    def _with_none(self) -> tuple[Array, Array]:
        """Residuals and covariance of all pairs, then of each detection without a pair: 0, and the identity."""
        (count, size), without = self.residual.shape, self.log_alone.shape[0] * self.residual.shape[1]
        width = count * size
        covariance = np.eye(width + without)
        covariance[:width, :width] = np.swapaxes(self.covariance, 1, 2).reshape(width, width)
        return np.concatenate([self.residual.ravel(), np.zeros(without)]), covariance

    def _pairs(self, assignments: Index) -> Index:
        """(K, D) the pairs that joint assignments contain; -1: of none of these objects."""
        places = np.full((len(self.log_alone), self.num_objects + 1), -1)
        places[self.rows, self.columns] = np.arange(len(self.rows))
        return np.asarray(places[np.arange(len(places)), np.minimum(assignments, self.num_objects)])

    def _table(self, values: Array) -> Array:
        """(..., D, M) table of values (..., P); -inf where there is no pair."""
        found = np.full((*values.shape[:-1], len(self.log_alone), self.num_objects), -np.inf)
        found[..., self.rows, self.columns] = values
        return found
