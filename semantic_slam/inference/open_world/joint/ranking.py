"""Ranking of a frame's joint assignments, with the evidence of the robot's pose that detections share.

About a locally optimal joint assignment each detection is weighed given the associations of the others. Weights are
then products over clusters of detections that compete for objects: exact where clusters are independent, and for all
assignments that differ from it in one detection. Assignments in which many detections differ at once, as the robot may
be elsewhere, are found from each pair of a detection and an object by itself.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from semantic_slam.geometry.arrays import Array, Flags, Index, broadcast_copy, distinct_rows
from semantic_slam.inference.association.gating import RankedAssignments, log_products, log_rest
from semantic_slam.inference.open_world.joint.costs import JointCosts

STEPS = 5
"""Most improvement steps from one joint assignment."""
PLACES = 3
"""Most joint assignments whose neighbourhoods are searched."""


@dataclass(frozen=True, kw_only=True)
class JointRanking:
    """Search for joint assignments of D detections; C columns are objects, then those not in ``costs``."""

    costs: JointCosts
    log_pairs: Array  # (D, C) log weights of pairs by themselves
    admitted: Flags  # (D, C)
    ranked: Callable[[Array], RankedAssignments]  # ranks by (D, C) log weights of pairs, with the mass left out
    reach: float  # nats behind the best beyond which no neighbourhood is searched

    def best(self, limit: int, gate: float) -> RankedAssignments:
        """The best by joint weight, at most ``limit``, none more than ``gate`` nats behind the best.

        As many pairs by themselves, the likeliest ones, are starts.
        """
        about = self._neighbourhoods(limit)
        found = [own.ranked.columns for own in about]
        columns, numbers = distinct_rows(np.concatenate(found))
        scores = self.costs.log_scores(columns)
        first = scores[numbers[np.cumsum([0, *(len(own) for own in found[:-1])])]]
        order = np.argsort(-scores, kind="stable")[:limit]
        order = order[scores[order] >= scores[order[0]] - gate]
        left_out = max(own.log_left_out(columns[order], score) for own, score in zip(about, first, strict=True))
        return RankedAssignments(columns[order], scores[order], left_out - float(scores[order[0]]))

    def _neighbourhoods(self, limit: int) -> list["_Neighbourhood"]:
        """The neighbourhood of the best joint assignment found, then of those outside the ones before."""
        tables = np.concatenate([self.log_pairs[None], self._filled(self.costs.given_each(self._likeliest(limit)))])
        starts, _ = distinct_rows(self._cheapest(tables))
        scores = self.costs.log_scores(starts)
        found: list[_Neighbourhood] = []
        for row in np.argsort(-scores, kind="stable"):
            if len(found) == PLACES or scores[row] < scores.max() - self.reach:
                break
            if not any(own.holds(starts[row]) for own in found):
                found.append(self._about(starts[row], float(scores[row])))
        return found

    def _likeliest(self, limit: int) -> Index:
        """At most ``limit`` pairs, those that are likeliest by themselves beside no known object."""
        costs = self.costs
        behind = costs.log_alone[costs.rows, -1] - self.log_pairs[costs.rows, costs.columns]
        return np.sort(np.argsort(behind, kind="stable")[:limit])

    def _about(self, start: Index, score: float) -> "_Neighbourhood":
        table = self._improved(start, score)
        return _Neighbourhood(log_pairs=table, log_new=self.costs.log_alone[:, -1], ranked=self.ranked(table))

    def _improved(self, start: Index, score: float) -> Array:
        """(D, C) log weights given the others, about an assignment improved step by step while its weight grows."""
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
        """(..., D, C) from (..., D, M): columns not in ``costs`` have their independent weights."""
        objects = slice(tables.shape[-1])
        found = broadcast_copy(self.log_pairs, (*tables.shape[:-1], self.log_pairs.shape[1]))
        found[..., objects] = np.where(self.admitted[:, objects], tables, self.log_pairs[:, objects])
        return found

    def _cheapest(self, tables: Array) -> Index:
        """(T, D) the best joint assignment of distinct columns by each of T tables of pairs (T, D, C)."""
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
        """Whether an assignment is in this neighbourhood."""
        return bool((self.ranked.columns == assignment).all(axis=1).any())

    def log_left_out(self, columns: Index, log_best: float) -> float:
        """Log mass of everything not among ``columns`` (K, D), the best of which has the joint weight ``log_best``."""
        own = self.ranked
        log_all = np.logaddexp(np.logaddexp.reduce(own.log_scores), own.log_left_out + own.log_scores[0])
        log_scale = float(log_best - own.log_scores[0])
        return log_scale + log_rest(float(log_all), log_products(self.log_pairs, self.log_new, columns))
