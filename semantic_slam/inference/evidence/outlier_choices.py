"""Geometric outliers in a joint assignment: the likeliest choice of outliers, and the evidence over all choices.

Every detection of a known object is an inlier or an outlier: 2^n choices for n detections, each a Gaussian over the
joint residual. A greedy search changes one detection at a time while that raises the likelihood, starting from no
outlier, and if that finds any also from all outliers; the likelier result enters the graph. The evidence of the other
choices is summed about it: exactly over all subsets of the few least decided detections, and over each further one as
if it were independent of the others, to which it is coupled only through the robot's pose.
"""

from dataclasses import dataclass
from itertools import product
from typing import Self

import numpy as np
from scipy.special import expit

from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.inference.models.noise.heavy_tail import HeavyTail

JOINT = 4
"""Number of least decided detections whose choices are summed jointly."""


@dataclass(frozen=True)
class OutlierChoices:
    """Outlier choices of G assignments of n detections each; m components of the joint residual."""

    outlier: Flags  # (G, n) the likeliest choice found, which no single change improves
    covariance: Array  # (G, m, m) of the residual under it
    log_density: Array  # (G,) of the residual over all choices, without the normalisers of single detections
    probability: Array  # (G, n) that each is an outlier

    @classmethod
    def of(cls, tail: HeavyTail, residual: Array, covariance: Array, measured: Flags) -> Self:
        """From ``residual`` (G, m), its ``covariance`` without outliers, and flags ``measured`` (G, n, m / n)."""
        search = _Search(tail, residual, covariance, measured)
        found = search.likeliest()
        log_sum, probability = search.summed(found)
        return cls(found.outlier, found.covariance, found.log_density + log_sum, probability)


def likeliest_outliers(tail: HeavyTail, residual: Array, covariance: Array, measured: Flags) -> Flags:
    """(G, n) only the choices of :meth:`OutlierChoices.of`, without the sums over the other choices."""
    return _Search(tail, residual, covariance, measured).likeliest().outlier


@dataclass
class _Whole:
    """The joint residuals under one choice for each of G assignments."""

    outlier: Flags  # (G, n) the choice
    covariance: Array  # (G, m, m)
    precision: Array  # (G, m, m)
    weighted: Array  # (G, m) precision times residual
    log_density: Array  # (G,) of the residual, times the prior probability of the choice
    log_odds: Array  # (G, n) log odds of changing the choice for one detection

    def replace(self, rows: Index, other: "_Whole") -> None:
        """Take over some rows."""
        for name, values in vars(self).items():
            values[rows] = getattr(other, name)

    def take(self, rows: Index) -> "_Whole":
        """Some rows."""
        return _Whole(*(values[rows] for values in vars(self).values()))


@dataclass(frozen=True)
class _Search:
    """Search over outlier choices for the joint residuals of G assignments."""

    tail: HeavyTail
    residual: Array  # (G, m)
    covariance: Array  # (G, m, m) if none is an outlier
    measured: Flags  # (G, n, m / n)

    def take(self, rows: Index) -> "_Search":
        """Some rows."""
        return _Search(self.tail, self.residual[rows], self.covariance[rows], self.measured[rows])

    @property
    def used(self) -> Flags:
        """(G, n) detections with any measured component."""
        return np.asarray(self.measured.any(axis=2))

    def likeliest(self) -> _Whole:
        """The likeliest choice found by greedy search from no outlier and, if that finds any, from all outliers."""
        found = self.improved(np.zeros(self.measured.shape[:2], dtype=bool))
        rows = np.flatnonzero(found.outlier.any(axis=1))
        if len(rows):
            doubted = self.take(rows)
            other = doubted.improved(doubted.used)
            better = other.log_density > found.log_density[rows]
            found.replace(rows[better], other.take(np.flatnonzero(better)))
        return found

    def improved(self, outlier: Flags) -> _Whole:
        """Improve a choice (G, n) greedily, one detection at a time, while that makes it likelier."""
        whole = self.at(outlier)
        for _ in range(2 * outlier.shape[1]):
            best = whole.log_odds.argmax(axis=1)
            rows = np.flatnonzero(np.take_along_axis(whole.log_odds, best[:, None], axis=1)[:, 0] > 0.0)
            if not len(rows):
                break
            changed = whole.outlier[rows]
            changed[np.arange(len(rows)), best[rows]] ^= True
            whole.replace(rows, self.take(rows).at(changed))
        return whole

    def at(self, outlier: Flags) -> _Whole:
        """Evaluate the choice ``outlier`` (G, n)."""
        covariance, diagonal = self.covariance.copy(), np.arange(self.residual.shape[1])
        added = self.tail.added * (outlier[..., None] & self.measured)
        covariance[:, diagonal, diagonal] += added.reshape(self.residual.shape)
        precision = np.asarray(np.linalg.inv(covariance), dtype=np.float64)
        weighted = (precision @ self.residual[..., None])[..., 0]
        log_choice = np.where(outlier, self.tail.log_share, self.tail.log_rest)
        log_density = -0.5 * (self.residual * weighted).sum(axis=1) - 0.5 * np.linalg.slogdet(covariance)[1]
        log_density += np.where(self.used, log_choice, 0.0).sum(axis=1)
        whole = _Whole(outlier.copy(), covariance, precision, weighted, log_density, np.zeros(outlier.shape))
        whole.log_odds = self._log_odds(whole, np.arange(outlier.shape[1])[None, :, None])
        return whole

    def _log_odds(self, whole: _Whole, sets: Index) -> Array:
        """(G, k) log odds of changing the choice for all of a set; ``sets`` (G or 1, k, q) detections, -1: padding."""
        count, size = len(self.residual), self.measured.shape[2]
        members = np.broadcast_to(sets, (count, *sets.shape[1:]))
        there, at, row = members >= 0, np.maximum(members, 0), np.arange(count)[:, None, None]
        sign = np.where(whole.outlier[row, at], -1.0, 1.0)
        there = there & self.used[row, at]
        added = (sign * there * self.tail.added)[..., None] * self.measured[row, at]
        places = (size * at[..., None] + np.arange(size)).reshape(*members.shape[:2], -1)
        added = added.reshape(places.shape)
        part = whole.precision[row[..., None], places[..., :, None], places[..., None, :]]
        weighted = whole.weighted[row, places]
        matrix = np.eye(places.shape[2]) + added[..., :, None] * part
        solved = np.linalg.solve(matrix, (added * weighted)[..., None])[..., 0]
        log_choice = (sign * there).sum(axis=2) * (self.tail.log_share - self.tail.log_rest)
        log_odds = log_choice + 0.5 * (weighted * solved).sum(axis=2) - 0.5 * np.linalg.slogdet(matrix)[1]
        return np.where(there.any(axis=2), log_odds, -np.inf)

    def summed(self, whole: _Whole) -> tuple[Array, Array]:
        """(G,) log of the evidence of all choices relative to this one, and (G, n) outlier probabilities."""
        outlier = whole.outlier
        few = min(JOINT, outlier.shape[1])
        order = np.argsort(-whole.log_odds, axis=1, kind="stable")
        others = np.ones(outlier.shape, dtype=bool)
        np.put_along_axis(others, order[:, :few], False, axis=1)
        alone = np.where(others, whole.log_odds, -np.inf)
        changes = np.array(list(product((False, True), repeat=few)))  # (2^q, q)
        sets = np.where(changes, order[:, None, :few], -1)
        log_weights = self._log_odds(whole, sets)
        log_weights[:, ~changes.any(axis=1)] = 0.0
        log_few = np.logaddexp.reduce(log_weights, axis=1)
        changed = expit(alone)
        shares = np.exp(log_weights - log_few[:, None]) @ changes
        np.put_along_axis(changed, order[:, :few], shares, axis=1)
        log_sum = log_few + np.logaddexp(0.0, alone).sum(axis=1)
        return log_sum, np.where(outlier, 1.0 - changed, changed)
