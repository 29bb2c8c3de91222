"""The manager: normalises over all candidates, prunes, commits the survivors and states the belief (Alg. 4.1).

The printed algorithm normalises inside the loop over components, which loses each parent's weight and evidence;
here w psi is collected over all parents and normalised once.
"""

from collections import Counter, deque
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semantic_slam.errors import SemanticSlamError
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.build import problem_of
from semantic_slam.inference.marginals import Mixture, state_belief
from semantic_slam.inference.object_table import ObjectTable, stack_rows, table_row
from semantic_slam.inference.objects import ObjectRegistry
from semantic_slam.inference.open_world.rounds import OpenRounds, TimeBudget
from semantic_slam.inference.ownership import assign_owners
from semantic_slam.inference.problem import Problem
from semantic_slam.inference.protocol import LOST, BackendPool, Candidates, Commit, Components, RunConfiguration
from semantic_slam.inference.pruning import Pruned, prune
from semantic_slam.inference.states.identity import ROOT_ID
from semantic_slam.inference.states.lineage import LineageStep

WINDOW = 10
"""Keyframes of ``discarded_mass_window``: what was discarded longer ago has shown, or it never will."""


@dataclass(frozen=True)
class Hypothesis:
    """A hypothesis as the manager knows it."""

    owner: int
    log_weight: float
    parent_id: int
    lineage: tuple[LineageStep, ...]


class HypothesisManager:
    """Drives the backends of ``pool`` through the two rounds of each keyframe.

    ``problem`` replaces the planar problem that the run announces.
    """

    def __init__(self, run: RunConfiguration, pool: BackendPool, problem: Problem | None = None):
        self.problem, self.pool, self.run_id = problem or problem_of(run), pool, run.run_id
        pool.start(run)
        self.registry = ObjectRegistry(self.problem.objects, len(self.problem.class_names))
        self.live = {
            ROOT_ID + number: Hypothesis(pool.backend_ids[0], log_weight, ROOT_ID + number, ())
            for number, log_weight in enumerate(self.problem.log_root_weights)
        }
        self.open_rounds = OpenRounds(self.problem) if self.problem.association == "open" else None
        self.budget = TimeBudget(self.problem.open_world.time_budget_ms, self.problem.pruning)
        self.lost: Counter[str] = Counter()  # hypotheses that backends had to give up, by reason
        self.log_kept_mass = 0.0  # log prod_k (1 - d_k)
        self.log_kept_lately: deque[float] = deque(maxlen=WINDOW)  # log (1 - d_k)
        self.log_evidence = 0.0  # log P(Z_1:k) under the hypotheses kept

    def process(self, keyframe: Any) -> HybridBelief:
        """One keyframe; raises SemanticSlamError when no hypothesis survives it."""
        self.budget.begin()
        step = self.problem.reader.step(keyframe)
        self.registry.introduce(step.index, len(step.names))
        if self.problem.association == "given":
            for name in step.names:
                self.registry.identify(name)
        answers = self._expand(keyframe, step.index)
        merged = self._without_copies(_merged(answers))
        pruned = prune(merged.log_weights, merged.ids, merged.log_missing, self.budget.limits())
        self.log_evidence += pruned.log_mass
        children = self._children(merged, pruned)
        children, components = self._update(step.index, children)
        self._accept(children, components, pruned.discarded)
        mixture = self._mixture(components)
        discarded = max(0.0, float(-np.expm1(self.log_kept_mass)))
        self.budget.end(len(self.live))
        registry = self.open_rounds.roster if self.open_rounds else self.registry
        first_new = self.registry.first_new_id(step.index) if self.open_rounds else None
        belief = state_belief(step, mixture, registry, self.problem.class_names, len(merged.ids), discarded, first_new)
        return replace(
            belief,
            num_merged=self.open_rounds.num_merged if self.open_rounds else 0,
            reproducible=not self.budget.is_on,
            log_evidence=pruned.log_mass,
            discarded_mass_window=max(0.0, float(-np.expm1(sum(self.log_kept_lately)))),
        )

    def _without_copies(self, merged: "_Merged") -> "_Merged":
        if self.open_rounds is None:
            return merged
        found = self.open_rounds.merge(
            merged.ids,
            merged.parent_ids,
            merged.log_weights,
            merged.poses,
            merged.object_poses,
            merged.associations,
            merged.classes,
        )
        return merged.take(found.kept, found.log_weights)

    def _expand(self, keyframe: Any, index: int) -> list[Candidates]:
        """Round one; hypotheses whose backend did not answer are rebuilt elsewhere from their lineage."""
        answers = self.pool.expand(keyframe)
        missing = set(self.live) - {int(n) for answer in answers for n in answer.expanded_parent_ids}
        if not missing:
            return answers
        if index == 0 or not self.pool.backend_ids:
            raise SemanticSlamError("no backend holds the first hypothesis; start the backends and run again")
        self._reassign(index - 1)
        answers = self.pool.expand(keyframe)
        if set(self.live) - {int(n) for answer in answers for n in answer.expanded_parent_ids}:
            raise SemanticSlamError("backends lost hypotheses twice in a row; see their logs")
        return answers

    def _reassign(self, index: int) -> None:
        self.live = self._redistributed(self.live)
        self.pool.commit(self._commit(index, self.live, always_lineage=True))

    def _redistributed(self, hypotheses: dict[int, Hypothesis]) -> dict[int, Hypothesis]:
        """The same hypotheses, owned by backends that are still there."""
        length = max((len(live.lineage) for live in hypotheses.values()), default=0)
        owners = assign_owners([live.owner for live in hypotheses.values()], self.pool.backend_ids, length)
        return {
            n: Hypothesis(owner, live.log_weight, live.parent_id, live.lineage)
            for (n, live), owner in zip(hypotheses.items(), owners, strict=True)
        }

    def _update(self, index: int, children: dict[int, Hypothesis]) -> tuple[dict[int, Hypothesis], dict[int, "_Row"]]:
        """Round two; children of a backend that did not answer are rebuilt elsewhere from their lineage."""
        answers = self.pool.commit(self._commit(index, children))
        if set(children) - _settled(answers) and self.pool.backend_ids:
            children = self._redistributed(children)
            answers = self.pool.commit(self._commit(index, children, always_lineage=True))
        lost = Counter(reason for answer in answers for reason in answer.lost_reasons)
        lost += Counter({"no backend answered": len(set(children) - _settled(answers))})
        self.lost.update({f"{LOST}: {reason}": count for reason, count in lost.items()})
        components = _by_id(self.open_rounds.aligned(answers) if self.open_rounds else answers)
        if not components:
            reasons = "; ".join(f"{count} x {reason}" for reason, count in lost.most_common(3))
            raise SemanticSlamError(f"every hypothesis was lost ({reasons}); check noise parameters and backends")
        return children, components

    def _children(self, merged: "_Merged", pruned: Pruned) -> dict[int, Hypothesis]:
        parents = [self.live[int(merged.parent_ids[row])] for row in pruned.kept]
        length = 1 + max((len(parent.lineage) for parent in parents), default=0)
        owners = assign_owners([parent.owner for parent in parents], self.pool.backend_ids, length)
        children: dict[int, Hypothesis] = {}
        for row, owner, parent, log_weight in zip(pruned.kept, owners, parents, pruned.log_weights, strict=True):
            step = LineageStep(
                tuple(merged.associations[row].tolist()), tuple(merged.classes[row].tolist()), int(merged.modes[row])
            )
            parent_id = int(merged.parent_ids[row])
            children[int(merged.ids[row])] = Hypothesis(owner, float(log_weight), parent_id, (*parent.lineage, step))
        return children

    def _commit(self, index: int, children: dict[int, Hypothesis], *, always_lineage: bool = False) -> Commit:
        holds = {n: live.owner for n, live in self.live.items()}
        moved = [always_lineage or holds.get(child.parent_id) != child.owner for child in children.values()]
        return Commit(
            run_id=self.run_id,
            keyframe=index,
            ids=np.array(list(children), dtype=np.uint64),
            parent_ids=np.array([child.parent_id for child in children.values()], dtype=np.uint64),
            steps=tuple(child.lineage[-1] for child in children.values()),
            log_weights=np.array([child.log_weight for child in children.values()]),
            owners=np.array([child.owner for child in children.values()], dtype=np.uint32),
            lineages=tuple(
                child.lineage[:-1] if move else () for child, move in zip(children.values(), moved, strict=True)
            ),
        )

    def _accept(self, children: dict[int, Hypothesis], components: dict[int, "_Row"], discarded: float) -> None:
        """Keep the children whose components could be updated; the rest is discarded mass."""
        kept = {n: child for n, child in children.items() if n in components}
        log_total = float(np.logaddexp.reduce([child.log_weight for child in kept.values()]))
        log_kept = float(np.log1p(-discarded)) + min(log_total, 0.0)
        self.log_kept_mass += log_kept
        self.log_kept_lately.append(log_kept)
        self.live = {
            n: Hypothesis(child.owner, child.log_weight - log_total, child.parent_id, child.lineage)
            for n, child in kept.items()
        }
        if self.open_rounds:
            self.open_rounds.forget()
            for n, child in kept.items():
                oldest = max(0, len(child.lineage) - self.problem.open_world.merge_keyframes)
                first_new = self.registry.first_new_id(oldest)
                objects = components[n].objects
                self.open_rounds.remember(n, child.lineage, objects.object_poses, objects.existence, first_new)

    def _mixture(self, components: dict[int, "_Row"]) -> Mixture:
        rows = [components[n] for n in self.live]
        return Mixture(
            ids=list(self.live),
            parent_ids=[live.parent_id for live in self.live.values()],
            log_weights=np.array([live.log_weight for live in self.live.values()]),
            lineages=[live.lineage for live in self.live.values()],
            poses=np.array([own.pose for own in rows]),
            pose_covariances=np.array([own.covariance for own in rows]),
            objects=stack_rows([own.objects for own in rows]),
        )


@dataclass(frozen=True)
class _Merged:
    ids: NDArray[np.uint64]
    parent_ids: NDArray[np.uint64]
    associations: NDArray[np.int32]
    classes: NDArray[np.int32]
    modes: NDArray[np.uint16]
    log_weights: Array
    poses: Array
    object_poses: Array
    log_missing: Array

    def take(self, rows: NDArray[np.int_], log_weights: Array) -> "_Merged":
        """Some of the candidates, with other weights."""
        return replace(
            self,
            ids=self.ids[rows],
            parent_ids=self.parent_ids[rows],
            associations=self.associations[rows],
            classes=self.classes[rows],
            modes=self.modes[rows],
            log_weights=log_weights,
            poses=self.poses[rows],
            object_poses=self.object_poses[rows],
        )


@dataclass(frozen=True)
class _Row:
    pose: Array
    covariance: Array
    objects: ObjectTable


def _merged(answers: list[Candidates]) -> _Merged:
    """Candidates of all backends in the order of their ids, whoever answered; the same hypothesis counts once."""
    filled = [answer for answer in answers if len(answer.ids)] or answers[:1]  # no row, no width: D is unknown there
    ids, order = np.unique(np.concatenate([answer.ids for answer in filled]), return_index=True)
    parents = np.concatenate([answer.expanded_parent_ids for answer in answers])
    missing = np.concatenate([answer.log_mass_not_enumerated for answer in answers])
    return _Merged(
        ids,
        np.concatenate([answer.parent_ids for answer in filled])[order],
        np.concatenate([answer.associations for answer in filled])[order],
        np.concatenate([answer.class_assignments for answer in filled])[order],
        np.concatenate([answer.modes for answer in filled])[order],
        np.concatenate([answer.log_weights for answer in filled])[order],
        np.concatenate([answer.poses for answer in filled])[order],
        np.concatenate([answer.object_poses for answer in filled])[order],
        missing[np.unique(parents, return_index=True)[1]],
    )


def _settled(answers: list[Components]) -> set[int]:
    """Ids of hypotheses that are held, or given up."""
    return {int(n) for answer in answers for n in (*answer.ids, *answer.lost_ids)}


def _by_id(answers: list[Components]) -> dict[int, _Row]:
    return {
        int(number): _Row(answer.poses[i], answer.pose_covariances[i], table_row(answer.objects, i))
        for answer in answers
        for i, number in enumerate(answer.ids)
    }
