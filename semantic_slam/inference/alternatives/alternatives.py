"""Reporting of association ambiguity that pruning removed: some hypotheses report alternative past associations.

A belief lists few histories; a client that asks whether two detections are of the same object sums their weights. After
pruning and merging, all remaining histories soon agree on every local association of the past, however uncertain it
was. So some hypotheses report an alternative in place of what they hold, such that the summed weights are again the
posterior probabilities. Only what is reported changes, in the form of revisions; the hypotheses themselves do not.
"""

from collections.abc import Mapping, Sequence
from typing import ClassVar, Protocol

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags
from semantic_slam.inference.alternatives.heirs import Heirs
from semantic_slam.inference.alternatives.shares import LEAST_SHARE, Shares
from semantic_slam.inference.alternatives.telling import balanced
from semantic_slam.inference.alternatives.told import Told, told_changes
from semantic_slam.inference.candidate_table import CandidateTable
from semantic_slam.inference.hypotheses import Hypothesis
from semantic_slam.inference.states.lineage import Lineage
from semantic_slam.inference.world.problem import Problem

MOST_GIVEN_UP = 300
"""Largest number of pruned histories, heaviest first, that are considered in one keyframe."""


class Held(Protocol):
    """The part of a component's report that is used here."""

    @property
    def covariance(self) -> Array:
        """(6, 6) of the robot's pose."""


class NoAlternatives:
    """Reports histories as they are; for closed worlds, where few local ambiguities arise."""

    STATE: ClassVar[tuple[str, ...]] = ()

    def follow(self, weighed: CandidateTable, live: Mapping[int, Hypothesis], held: Mapping[int, Held]) -> None:
        """Do nothing: pruned histories are not remembered."""

    def enter(self, live: Mapping[int, Hypothesis]) -> None:
        """Do nothing: revised histories have no alternatives, either."""

    def told(self, live: Mapping[int, Hypothesis]) -> list[tuple[int, int, int, int]]:
        """(hypothesis, keyframe, detection, object or -1) wherever a revised history differs from what it revises."""
        return [(number, *change) for number, hypothesis in live.items() for change in hypothesis.changes()]


class Alternatives:
    """Remembers the associations that pruned open-world histories had; updated by the engine at every keyframe."""

    STATE: ClassVar[tuple[str, ...]] = ("_lineages", "_shares", "_known", "_told", "_tells", "_renamed")

    def __init__(self, problem: Problem, root_ids: Sequence[int]) -> None:
        self._problem = problem
        self._lineages: dict[int, Lineage] = {number: () for number in root_ids}  # of the live hypotheses
        self._shares = Shares(values=np.zeros((0, len(root_ids))))
        self._known = 0  # number of alternatives that are older than the newest keyframe
        self._told = Told.nothing(root_ids)  # what the newest belief reports
        self._tells: Flags = np.zeros((0, len(root_ids)), dtype=bool)  # (R, H) alternatives that live ones report
        self._renamed: dict[int, dict[int, int]] = {}  # per live hypothesis, see `_renamed`

    def follow(self, weighed: CandidateTable, live: Mapping[int, Hypothesis], held: Mapping[int, Held]) -> None:
        """Update after pruning: each pruned candidate becomes an alternative to a similar ``live`` one, its heir."""
        columns = {number: column for column, number in enumerate(self._lineages)}
        parents = np.array([columns[hypothesis.parent_id] for hypothesis in live.values()], dtype=int)
        before, self._known = self._shares, len(self._shares.changes)
        self._shares, self._tells = before.of_children(parents), self._tells[:, parents]
        self._renamed = {
            n: _renamed(hypothesis, self._renamed.get(hypothesis.parent_id, {})) for n, hypothesis in live.items()
        }
        place = {int(number): row for row, number in enumerate(weighed.ids)}
        rows = np.array([place[number] for number in live], dtype=int)
        covariances = np.array([held[number].covariance for number in live])
        heirs = Heirs(self._problem, weighed, rows, covariances, self._lineages)
        weights = np.exp(weighed.log_weights - weighed.log_weights.max())
        total = weights[rows]
        for row in self._given_up(weights, rows):
            found = heirs.of(row)
            if found is None:
                continue
            heir, changes = found
            total[heir] += weights[row]
            its = before.values[:, columns[int(weighed.parent_ids[row])]]
            self._shares.give_up(weights[row] / total[heir], changes, its, heir)
        self._lineages = {number: hypothesis.lineage for number, hypothesis in live.items()}

    def enter(self, live: Mapping[int, Hypothesis]) -> None:
        """Update after revisions entered: each inherits the alternatives of the hypothesis that it revises."""
        columns = {number: column for column, number in enumerate(self._lineages)}
        by_lineage = {id(lineage): number for number, lineage in self._lineages.items()}
        sources = {
            n: n if hypothesis.revises is None else by_lineage.get(id(hypothesis.revises.lineage), n)
            for n, hypothesis in live.items()
        }
        chosen = np.array([columns[source] for source in sources.values()], dtype=int)
        self._shares, self._tells = self._shares.of_children(chosen), self._tells[:, chosen]
        self._renamed = {n: _renamed(hypothesis, self._renamed.get(sources[n], {})) for n, hypothesis in live.items()}
        self._lineages = {number: hypothesis.lineage for number, hypothesis in live.items()}

    def told(self, live: Mapping[int, Hypothesis]) -> list[tuple[int, int, int, int]]:
        """(hypothesis, keyframe, detection, object or -1) where a history, as reported, differs from its parent's."""
        weights = np.exp([hypothesis.log_weight for hypothesis in live.values()])
        known = self._shares.take(np.arange(self._known))
        tells = balanced(self._tells, known, weights)
        now = Told.of(self._lineages, known.changes, tells, self._renamed)
        changes = told_changes(self._told, now, live)
        self._told = now
        new = len(self._shares.changes) - self._known
        self._tells = np.concatenate([tells, np.zeros((new, tells.shape[1]), dtype=bool)])
        self._forget()
        return changes

    def _given_up(self, weights: Array, rows: Array) -> list[int]:
        """Rows of the pruned candidates whose weight is not negligible, heaviest first."""
        others = np.setdiff1d(np.arange(len(weights)), rows)
        others = others[np.argsort(-weights[others], kind="stable")][:MOST_GIVEN_UP]
        return [int(row) for row in others if weights[row] >= LEAST_SHARE * weights[rows].min()]

    def _forget(self) -> None:
        """Drop alternatives that no hypothesis reports and that are likely in none."""
        kept = np.flatnonzero(self._shares.likely() | self._tells.any(axis=1) | self._told.tells_any(len(self._tells)))
        self._shares, self._tells = self._shares.take(kept), self._tells[kept]
        self._told = self._told.take(kept)


def _renamed(hypothesis: Hypothesis, before: Mapping[int, int]) -> dict[int, int]:
    """Object ids in a hypothesis, by their ids before its revisions merged objects."""
    if hypothesis.revises is None:
        return dict(before)
    news: dict[int, set[int]] = {}
    for k, detection, number in hypothesis.changes():
        news.setdefault(hypothesis.revises.lineage[k].association[detection], set()).add(number)
    new = {old: next(iter(numbers)) for old, numbers in news.items() if len(numbers) == 1}
    return {old: new.get(number, number) for old, number in before.items()} | new
