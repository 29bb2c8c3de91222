"""The best joint assignments of a frame, weighed over the robot's pose that its detections share.

About a joint assignment that changes of single detections do not improve, each detection is weighed given what the
others are of. Weights are then products over clusters of detections that may be of one object: exact where clusters are
independent, and for all that differs in one detection anywhere. Assignments in which many detections differ at once,
for the robot may stand elsewhere, are found from each pair of a detection and an object by itself.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from semantic_slam.geometry.arrays import Array, Flags, Index, broadcast_copy, distinct_rows
from semantic_slam.inference.association.gating import RankedAssignments, log_products, log_rest
from semantic_slam.inference.open_world.joint.costs import JointCosts

STEPS = 5
"""From one joint assignment to better ones, at most."""
PLACES = 3
"""Joint assignments at most about which others are looked for."""


@dataclass(frozen=True, kw_only=True)
class JointRanking:
    """How joint assignments of D detections are looked for; C columns are objects, and then what ``costs`` has not."""

    costs: JointCosts
    log_pairs: Array  # (D, C) of pairs by themselves
    admitted: Flags  # (D, C)
    ranked: Callable[[Array], RankedAssignments]  # the best by (D, C) log weights of pairs, and the mass of others
    reach: float  # nats behind the best from which on nobody asks what else is about a joint assignment

    def best(self, limit: int, gate: float) -> RankedAssignments:
        """By their joint weights, at most ``limit``, none more than ``gate`` nats behind the best."""
        about = self._neighbourhoods()
        found = [own.ranked.columns for own in about]
        columns, numbers = distinct_rows(np.concatenate(found))
        scores = self.costs.log_scores(columns)
        first = scores[numbers[np.cumsum([0, *(len(own) for own in found[:-1])])]]
        order = np.argsort(-scores, kind="stable")[:limit]
        order = order[scores[order] >= scores[order[0]] - gate]
        left_out = max(own.log_left_out(columns[order], score) for own, score in zip(about, first, strict=True))
        return RankedAssignments(columns[order], scores[order], left_out - float(scores[order[0]]))

    def _neighbourhoods(self) -> list["_Neighbourhood"]:
        """About the best joint assignment that is found, and then about those that are not near one before."""
        tables = np.concatenate([self.log_pairs[None], self._filled(self.costs.given_each())])
        starts, _ = distinct_rows(self._cheapest(tables))
        scores = self.costs.log_scores(starts)
        found: list[_Neighbourhood] = []
        for row in np.argsort(-scores, kind="stable"):
            if len(found) == PLACES or scores[row] < scores.max() - self.reach:
                break
            if not any(own.holds(starts[row]) for own in found):
                found.append(self._about(starts[row], float(scores[row])))
        return found

    def _about(self, start: Index, score: float) -> "_Neighbourhood":
        table = self._improved(start, score)
        return _Neighbourhood(log_pairs=table, log_new=self.costs.log_alone[:, -1], ranked=self.ranked(table))

    def _improved(self, start: Index, score: float) -> Array:
        """(D, C) what the others say of each detection, taken at its word while that makes the whole more likely."""
        table = self._given_others(start)
        for _ in range(STEPS):
            better = self._cheapest(table[None])[0]
            if (better == start).all():
                break
            own = float(self.costs.log_scores(better[None])[0])
            if own <= score:
                break
            start, score, table = better, own, self._given_others(better)
        return table

    def _given_others(self, assignment: Index) -> Array:
        return self._filled(self.costs.given_others(assignment))

    def _filled(self, tables: Array) -> Array:
        """(..., D, C) from (..., D, M): what is no pair of ``costs`` weighs what it weighs by itself."""
        objects = slice(tables.shape[-1])
        found = broadcast_copy(self.log_pairs, (*tables.shape[:-1], self.log_pairs.shape[1]))
        found[..., objects] = np.where(self.admitted[:, objects], tables, self.log_pairs[:, objects])
        return found

    def _cheapest(self, tables: Array) -> Index:
        """(T, D) the joint assignments of distinct columns that weigh most by each of T tables of pairs (T, D, C)."""
        count, known = self.log_pairs.shape
        costs = np.full((len(tables), count, known + count), np.inf)
        costs[:, :, :known] = np.where(self.admitted, -tables, np.inf)
        costs[:, np.arange(count), known + np.arange(count)] = -self.costs.log_alone[:, -1]
        return np.array([linear_sum_assignment(cost)[1] for cost in costs])


@dataclass(frozen=True, kw_only=True)
class _Neighbourhood:
    """The joint assignments about one of them, weighed as products over clusters."""

    log_pairs: Array  # (D, C) given the others
    log_new: Array  # (D,)
    ranked: RankedAssignments

    def holds(self, assignment: Index) -> bool:
        """Whether it was found here."""
        return bool((self.ranked.columns == assignment).all(axis=1).any())

    def log_left_out(self, columns: Index, log_best: float) -> float:
        """Log mass of all that is not among ``columns`` (K, D), where the best of them weighs ``log_best`` jointly."""
        own = self.ranked
        log_all = np.logaddexp(np.logaddexp.reduce(own.log_scores), own.log_left_out + own.log_scores[0])
        log_scale = float(log_best - own.log_scores[0])
        return log_scale + log_rest(float(log_all), log_products(self.log_pairs, self.log_new, columns))
