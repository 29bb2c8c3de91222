"""Hypothesis expansion, round one of a keyframe: predict → associate → weigh → semantics, all parents at once."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.association.strategy import AssociationStrategy, Parents, PredictedKeyframe
from semantic_slam.inference.evidence.assignments import Assignments
from semantic_slam.inference.evidence.weighed_associations import WeighedAssociations
from semantic_slam.inference.models.noise.noise_settings import NoiseSettings
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.reassociation.reassociation import Reassociation
from semantic_slam.inference.reassociation.solved import RevisedComponent
from semantic_slam.inference.semantics.interface import SemanticEvidence
from semantic_slam.inference.smoothing.component import Component, WeightedComponent
from semantic_slam.inference.smoothing.component_update import ComponentUpdate
from semantic_slam.inference.smoothing.errors import LostComponentError
from semantic_slam.inference.smoothing.growth import Outcome, grow
from semantic_slam.inference.smoothing.past.horizon import oldest_kept
from semantic_slam.inference.states.lineage import LineageStep, next_id
from semantic_slam.inference.states.tracked_objects import ExistenceUpdate
from semantic_slam.inference.world.carried import NEW_GROUND, NOWHERE
from semantic_slam.inference.world.problem import Problem
from semantic_slam.inference.world.slips import Slips

LEAST_SHARE = 0.2
"""Least weight of a hypothesis for which a wheel slip is weighed as an alternative motion."""


@dataclass(frozen=True, kw_only=True)
class Expansion:
    """The K candidates of a keyframe with their weights, and all that is needed to grow those that survive."""

    step: Step  # its motion is the one that the candidates assume: odometry, or a kidnapping
    parents: Parents  # P; a revised variant of a parent has the id of the parent that it revises
    keyframe: PredictedKeyframe
    candidates: WeighedAssociations
    ids: list[int]  # K
    steps: list[LineageStep]  # K
    log_psi: Array  # (K,) likelihood factor of Eq. 4.18, without the parent's weight
    log_left_out: Array  # (P,) estimate of the mass not weighed, relative to the parent's weight
    effective_sample_sizes: Array  # (K,) NaN where nothing was sampled
    semantics: SemanticEvidence
    existence: Sequence[ExistenceUpdate]  # K

    @property
    def assignments(self) -> Assignments:
        """Assignments of detections to objects, one row per candidate."""
        return self.candidates.assignments

    @property
    def used(self) -> Index:
        """(n,) indices of the detections that are associated; the others are clutter in every candidate."""
        return self.keyframe.used

    def updates(self, rows: Sequence[int]) -> list[ComponentUpdate]:
        """The factors and records that some candidates add to the components of their parents."""
        added = self.keyframe.updates(self.candidates, rows, self.existence)
        records = self.semantics.records(rows)
        corrections = [self.semantics.robot[row] for row in rows]
        return [
            replace(update, views=views, robot_correction=correction)
            for update, views, correction in zip(added, records, corrections, strict=True)
        ]


class Expander:
    """Weighs candidates and grows those that survive; stateless: results depend on the problem and arguments alone."""

    def __init__(self, problem: Problem, association: AssociationStrategy):
        self.problem, self.association = problem, association
        self.reassociation = Reassociation(problem, association)

    def expand(
        self,
        step: Step,
        parent_ids: Sequence[int],
        held: Sequence[WeightedComponent],
        path: LineageStep | None = None,
        carried: int = NOWHERE,
    ) -> Expansion:
        """PropWeights of Algorithm 4.1 for every parent, or along ``path`` only. Raises LostComponentError, InputError.

        ``path`` is the one continuation wanted when a lineage is replayed. ``carried`` is the lattice point to which a
        kidnapped robot was moved, NOWHERE for none; with a ``path``, its step states that.
        """
        if path is not None and step.index > 0 and path.lattice_point:
            path, carried = path.with_lattice_point(NOWHERE), path.lattice_point
        slips = self.problem.slips if step.index > 0 else None
        try:
            if carried == NOWHERE or self.problem.carried is None:
                return self._expanded(step, parent_ids, held, path, slips)
            there = self.problem.carried.step(step, carried)
            if carried == NEW_GROUND:
                held = [replace(weighted, component=weighted.component.on_new_ground()) for weighted in held]
            return self._carried(self._expanded(there, parent_ids, held, path), carried)
        except np.linalg.LinAlgError as fault:
            raise InputError(
                f"keyframe {step.index}: a covariance cannot be factorised ({fault}); check the standard deviations of"
                " odometry, detections, initial pose and map, which are too large or too small beside each other"
            ) from None

    def _expanded(
        self,
        step: Step,
        parent_ids: Sequence[int],
        held: Sequence[WeightedComponent],
        path: LineageStep | None,
        slips: Slips | None = None,
    ) -> Expansion:
        parents, revisions = self._with_revised(step, Parents.of(parent_ids, held), path)
        if slips is not None:
            parents, revisions = _with_slipping(slips, parents, revisions, path)
            path = path if path is None else path.without_slip()
        keyframe = self.association.predict(step, parents, path)  # by the motion model: Eqs. 4.11, 4.21
        candidates = keyframe.weigh(keyframe.associate())  # every beta_k, Eq. 4.20; classes and modes
        semantics = self._semantics(keyframe, candidates)
        factors, existence = keyframe.existence(candidates)
        rows = candidates.assignments
        steps = [
            _told(taken, revisions[parent], parents.components[parent])
            for taken, parent in zip(candidates.steps(keyframe.used, len(step.names)), rows.parents, strict=True)
        ]
        used = [step.detections[number] for number in keyframe.used]
        gains = np.array([revision.log_gain + revision.component.log_change(used) for revision in revisions])
        if slips is not None:
            gains = gains + slips.log_weights(parents.components)
        log_psi = _log_psi(rows, semantics, factors) + gains[rows.parents]
        return Expansion(
            step=step,
            parents=parents,
            keyframe=keyframe,
            candidates=candidates,
            ids=[next_id(parents.ids[p], step.stamp_ns, taken) for p, taken in zip(rows.parents, steps, strict=True)],
            steps=steps,
            log_psi=log_psi,
            log_left_out=candidates.log_left_out + _best_of_parents(rows.parents, log_psi, len(parents)),
            effective_sample_sizes=_effective_sample_sizes(rows, semantics),
            semantics=semantics,
            existence=existence,
        )

    def _carried(self, expansion: Expansion, point: int) -> Expansion:
        """The candidates, with the prior weight of a kidnapping to that lattice point."""
        assert self.problem.carried is not None
        assumed = [component.noise_settings or NoiseSettings() for component in expansion.parents.components]
        weights = [self.problem.carried.log_weight(point, settings.odometry_factor) for settings in assumed]
        rows, steps = expansion.assignments, [taken.with_lattice_point(point) for taken in expansion.steps]
        stamp_ns, ids = expansion.step.stamp_ns, expansion.parents.ids
        return replace(
            expansion,
            ids=[next_id(ids[parent], stamp_ns, taken) for parent, taken in zip(rows.parents, steps, strict=True)],
            steps=steps,
            log_psi=expansion.log_psi + np.array(weights)[rows.parents],
        )

    def grow(self, expansion: Expansion, rows: Sequence[int], *, in_place: bool) -> list[Outcome]:
        """Fork and update the parents' components for some candidates; past poses beyond the horizon are marginalised.

        ``in_place``: the parents are not needed any more, so that a child may reuse its parent's smoother.
        """
        parents = [expansion.parents.components[parent] for parent in expansion.assignments.parents[list(rows)]]
        max_fresh = self.problem.open_world.max_joint_objects
        grown = grow(parents, expansion.step.motion, expansion.updates(rows), in_place=in_place, max_fresh=max_fresh)
        oldest = oldest_kept(self.problem.history, expansion.step.index)
        return grown if oldest is None else [_without_past(outcome, oldest) for outcome in grown]

    def _with_revised(
        self, step: Step, parents: Parents, path: LineageStep | None
    ) -> tuple[Parents, list[RevisedComponent]]:
        """The parents, plus variants with past detections reassociated to other objects, where that is likelier.

        This is loop-closure association in hindsight. With a ``path`` only the variant that it names, in place of its
        parent.
        """
        plain = [RevisedComponent(component) for component in parents.components]
        if not self.reassociation.is_on:
            return parents, plain
        if path is not None:
            variant = (
                self.reassociation.revised(step, parents.components[0], path.changes) if path.changes else plain[0]
            )
            return replace(parents, components=[variant.component]), [variant]
        found = self.reassociation.looked_for(step, parents)
        if not found:
            return parents, plain
        variants = [variant.component for variant in found.values()]
        return parents.extended(list(found), variants), [*plain, *found.values()]

    def _semantics(self, keyframe: PredictedKeyframe, candidates: WeighedAssociations) -> SemanticEvidence:
        if not len(keyframe.used):
            return SemanticEvidence.silent(len(candidates.assignments))
        return self.problem.semantics.weigh(keyframe.semantic_input(candidates))


def _told(step: LineageStep, revised: RevisedComponent, parent: Component) -> LineageStep:
    """A candidate's lineage step, with the reassociations of its parent, and whether its motion slipped."""
    if revised.changes:
        step = replace(step, changes=revised.changes)
    return step.with_slip() if parent.slip is not None else step


def _with_slipping(
    slips: Slips, parents: Parents, revisions: list[RevisedComponent], path: LineageStep | None
) -> tuple[Parents, list[RevisedComponent]]:
    """The parents, plus the likely ones with a wheel slip in this motion; with a ``path``, as it states."""
    if path is not None:
        if not path.slipped:
            return parents, revisions
        return replace(parents, components=[slips.slipping(component) for component in parents.components]), revisions
    places = np.flatnonzero(parents.log_weights >= np.log(LEAST_SHARE)).tolist()
    variants = [slips.slipping(parents.components[place]) for place in places]
    return parents.extended(places, variants), [*revisions, *(revisions[place] for place in places)]


def _without_past(outcome: Outcome, oldest: int) -> Outcome:
    if isinstance(outcome, LostComponentError):
        return outcome
    try:
        return outcome.without_past(oldest)
    except LostComponentError as fault:
        return fault


def _log_psi(rows: Assignments, semantics: SemanticEvidence, factors: Array) -> Array:
    """(K,) log psi of Eq. 4.18: geometry, semantic factors, class priors, views without factors, births and misses."""
    return rows.column("log_evidence") + rows.column("log_class_prior") + semantics.log_weights + factors


def _effective_sample_sizes(rows: Assignments, semantics: SemanticEvidence) -> Array:
    return np.asarray(np.fmin(rows.column("effective_sample_sizes"), semantics.effective_sample_sizes))


def _best_of_parents(parents: Index, scores: Array, count: int) -> Array:
    """(P,) largest score of each parent's candidates."""
    best = np.full(count, -np.inf)
    np.maximum.at(best, parents, scores)
    return best
