"""A keyframe with an unknown number of objects: a Poisson multi-Bernoulli mixture (PMBM) over SLAM hypotheses.

A detection belongs to an object that its hypothesis knows, or to none; in the latter case it starts a new object
(birth), whose existence probability weighs objects undetected so far against false alarms. A missed detection lowers an
object's existence, and its hypothesis's weight, by the same probabilities.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.association.candidate_limit import candidate_limit
from semantic_slam.inference.association.enumeration import EnumerationProblem, enumerate_classes
from semantic_slam.inference.association.gating import PairDensities, RankedAssignments
from semantic_slam.inference.association.pair_search import LARGEST_BEND
from semantic_slam.inference.association.strategy import Parents
from semantic_slam.inference.evidence.assignments import Assignments
from semantic_slam.inference.evidence.laplace import WEIGHING_TOLERANCE, find_modes
from semantic_slam.inference.evidence.search_start import search_start
from semantic_slam.inference.evidence.weighed_associations import WeighedAssociations
from semantic_slam.inference.models.step import AssociatedDetection, Step
from semantic_slam.inference.open_world.joint.leave_one_out import log_density_of_each
from semantic_slam.inference.open_world.joint.linear_evidence import LinearisedEvidence
from semantic_slam.inference.open_world.keyframe.existence_accounts import ExistenceAccounts
from semantic_slam.inference.open_world.keyframe.keyframe_problems import open_keyframe_problem
from semantic_slam.inference.open_world.keyframe.mover_updates import movers_after
from semantic_slam.inference.open_world.prediction.prediction import Prediction
from semantic_slam.inference.semantics.interface import SemanticInput
from semantic_slam.inference.smoothing.component_update import ComponentUpdate
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.lineage import MOVES, LineageStep
from semantic_slam.inference.states.outlier_counts import OutlierCounts
from semantic_slam.inference.states.tracked_objects import ExistenceUpdate
from semantic_slam.inference.world.objects import ObjectRegistry
from semantic_slam.inference.world.problem import Problem

UNLIKELY = 10.0
"""Nats behind its parent's best candidate from which on a candidate is weighed by the linearisation, however
nonlinear."""


@dataclass(frozen=True, kw_only=True)
class OpenKeyframe:
    """One keyframe of P parents, each with its own objects; all n detections are used."""

    problem: Problem
    registry: ObjectRegistry
    step: Step
    parents: Parents
    path: LineageStep | None  # the only continuation wanted; None: all
    predictions: list[Prediction]  # P
    pairs: list[PairDensities]  # P
    ranked: list[RankedAssignments]  # P

    @cached_property
    def used(self) -> Index:
        """(n,) indices of the detections used: all of them, as each may start an object or be a false alarm."""
        return np.arange(len(self.step.detections))

    @property
    def detections(self) -> Sequence[Any]:
        """(n,) the detections used."""
        return self.step.detections

    @cached_property
    def born(self) -> Index:
        """(n,) ids of the objects that the detections would start: determined by the keyframes so far."""
        return self.registry.first_new_id(self.step.index) + self.used

    @cached_property
    def known(self) -> Index:
        """(N,) ids of the objects near some parent's detections and of moving objects, ascending."""
        ids = [own for prediction in self.predictions for own in (prediction.near_ids, prediction.mover_ids)]
        return np.unique(np.concatenate(ids)).astype(int)

    def _places(self, object_ids: Index) -> Index:
        """(m,) positions of known object ids in ``known``."""
        return np.asarray(np.searchsorted(self.known, object_ids))

    @property
    def object_ids(self) -> Index:
        """(N + n,) ids of the known objects, then of those that may be born."""
        return np.concatenate([self.known, self.born]).astype(int)

    def associate(self) -> WeighedAssociations:
        """The best joint assignments of each parent, as candidates."""
        counts = [len(item.columns) for item in self.ranked]
        born = len(self.known) + np.arange(len(self.born))
        places = [
            np.concatenate([self._places(own.near_ids), born, self._places(own.mover_ids), [-1]])[item.columns]
            for own, item in zip(self.predictions, self.ranked, strict=True)
        ]
        rows = Assignments(
            parents=np.repeat(np.arange(len(self.parents)), counts),
            objects=np.concatenate(places).astype(int).reshape(sum(counts), -1),
            log_evidence=np.concatenate([item.log_scores for item in self.ranked]),
            classes=self._kinds,
            log_class_prior=np.zeros(sum(counts)),
            effective_sample_sizes=np.full(sum(counts), np.nan),
        )
        left_out = np.array([item.log_left_out for item in self.ranked])
        new = len(self.born)
        return WeighedAssociations(assignments=rows, object_ids=self.object_ids, log_left_out=left_out, num_new=new)

    @property
    def _kinds(self) -> Index | None:
        """(K, D) MOVES where a detection is of a moving object, else -1, in place of classes; None: nothing moves."""
        if not self.problem.moving.is_on:
            return None
        parts = [
            item.columns >= len(own.near) + len(self.used)
            for own, item in zip(self.predictions, self.ranked, strict=True)
        ]
        return np.where(np.concatenate(parts), MOVES, -1)

    def weigh(self, candidates: WeighedAssociations) -> WeighedAssociations:
        """Candidates weighed: with classes at their modes; without, by one linearisation where that is accurate."""
        has_classes = self.problem.model.num_classes > 0 and len(self.used) > 0
        weighed = self._with_classes(candidates) if has_classes else self._by_linearisation(candidates)
        if self.step.index > 0:
            return weighed
        components = self.parents.components
        root_numbers = [self.problem.with_start(component.noise_index, component.start) for component in components]
        return weighed.gaining(numbers=np.array(root_numbers)[weighed.assignments.parents])

    def semantic_input(self, candidates: WeighedAssociations) -> SemanticInput:
        """Input of the semantic models; an object that no map knows may be of any class."""
        return SemanticInput(
            step=self.step,
            parents=self.parents.components,
            candidates=candidates,
            used=self.used,
            log_class_prior=self.registry.log_class_prior_of(self.object_ids.tolist()),
            new=self._births,
        )

    @property
    def expected_births(self) -> Array:
        """(P,) expected number of first detections under each parent."""
        return np.array([own.rates.average(own.expected_births) for own in self.predictions])

    def existence(self, candidates: WeighedAssociations) -> tuple[Array, Sequence[ExistenceUpdate]]:
        """Log factors of births, detections and misses, with the gravity evidence, and the existence updates.

        The evidence of the direction of gravity is the same for every association.
        """
        accounts = ExistenceAccounts(self.problem, self.step, self.predictions, self.born)
        factors, updates = accounts.of(candidates.assignments, candidates.assignments.object_ids(self.object_ids))
        return factors + self._log_levels[candidates.assignments.parents], updates

    @cached_property
    def _log_levels(self) -> Array:
        """(P,) log evidence of the direction of gravity."""
        return np.array([own.log_level for own in self.predictions])

    def updates(
        self, candidates: WeighedAssociations, rows: Sequence[int], existence: Sequence[ExistenceUpdate]
    ) -> list[ComponentUpdate]:
        """One component update per row, with a local map where updates are not iterated."""
        some = candidates.assignments.take(np.array(rows, dtype=int))
        steps = replace(candidates, assignments=some).steps(np.arange(len(self.used)), len(self.used))
        return [self._update(some, row, steps[row], existence[number]) for row, number in enumerate(rows)]

    def _agreeing(self, parent: int, taken: LineageStep, update: ExistenceUpdate) -> ExistenceUpdate:
        """The existence update of a continuation, with the densities of its detections in the track scores."""
        near = {n: column for column, n in enumerate(self.predictions[parent].near_ids.tolist())}
        seen = [
            number
            for number, (n, kind) in enumerate(zip(taken.association, taken.class_assignment, strict=True))
            if n in near and kind != MOVES
        ]
        if update.track_scores is None or not seen:
            return update
        columns = np.array([near.get(n, -1) for n in taken.association], dtype=int)
        linear = self._linearised_of(parent)
        log_densities = log_density_of_each(linear.innovation(columns, seen), linear.tail)
        return update.agreeing(self.predictions[parent].near[columns[seen]], log_densities)

    def _update(self, own: Assignments, row: int, taken: LineageStep, existence: ExistenceUpdate) -> ComponentUpdate:
        states, robot = own.column("object_states")[row], own.column("robot")[row]
        parent = int(own.parents[row])
        prediction, births = self.predictions[parent], self._births[parent]
        given = zip(prediction.detections, taken.association, taken.class_assignment, strict=True)
        pairs = list(zip(taken.association, taken.class_assignment, strict=True))
        standing = [number for number, (object_id, kind) in enumerate(pairs) if object_id >= 0 and kind != MOVES]
        observed = [AssociatedDetection(*item, number) for number, item in enumerate(given)]
        if (tail := self.pairs[parent].tail) is not None:
            for number in np.flatnonzero(own.column("outlier")[row]).tolist():
                observed[number] = observed[number].as_outlier(tail.width)
        known = [number for number in standing if taken.association[number] not in births]
        modes = dict(zip(taken.association, states, strict=True))
        local = None
        if self.parents.components[parent].single_steps:
            local = prediction.local_after(self.pairs[parent], [observed[number] for number in standing], births)
        observer = None if prediction.movers is None else own.observers(np.array([row]))
        least = self.problem.open_world.least_existence
        return ComponentUpdate(
            observed=[observed[number] for number in standing],
            objects=list(states[standing]),
            robot=robot,
            movers=movers_after(prediction, taken, observer, existence, least),
            predicted=prediction.objects.robot,
            new_objects={int(n): births[int(n)].at(modes[int(n)], robot) for n in existence.new_ids},
            existence=self._agreeing(parent, taken, existence),
            local=local,
            errors=None if prediction.errors is None else prediction.errors.transition,
            propagated_errors=prediction.propagated_errors,
            outliers=None if tail is None else self._outliers(own, row, known),
        )

    def _outliers(self, own: Assignments, row: int, known: list[int]) -> OutlierCounts:
        """Outlier counts of an assignment's parent, with this keyframe's detections of ``known`` objects added."""
        before = self.parents.components[int(own.parents[row])].outliers
        return before.with_more(own.column("outlier_probability")[row, known])

    @cached_property
    def _births(self) -> list[dict[int, GaussianPrior]]:
        """Priors of the objects that the detections would start, by id, for each parent."""
        born = self.born.tolist()
        return [{n: own.prior for n, own in zip(born, each.births, strict=True)} for each in self.predictions]

    def _by_linearisation(self, candidates: WeighedAssociations) -> WeighedAssociations:
        """Candidates weighed by one linearisation at the prediction, or by a mode search each where nonlinear."""
        rows, scores = candidates.assignments, candidates.assignments.column("log_evidence")
        parts: list[Assignments] = []
        curved: list[int] = []
        for parent, (own, ranked) in enumerate(zip(self._linearised, self.ranked, strict=True)):
            numbers = np.flatnonzero(rows.parents == parent)
            columns = ranked.columns
            moves = columns >= len(self.predictions[parent].near) + len(self.used)
            part = own.evaluate(rows.take(numbers), np.where(moves, -1, columns))
            likely = scores[numbers] >= scores[numbers].max() - UNLIKELY
            curved += numbers[(part.column("bend") > LARGEST_BEND) & likely].tolist()
            parts.append(part)
        found = Assignments.joined(parts)
        if curved and len(self.used) and self._suits_searches:
            found = found.with_rows(np.array(curved), self._searched(found.take(np.array(curved))))
        return replace(candidates, assignments=self._with_movers(found))

    def _with_movers(self, rows: Assignments) -> Assignments:
        """Assignments with detections of moving objects weighed and placed, given the robot's pose at their modes."""
        if rows.classes is None or not (rows.classes == MOVES).any():
            return rows
        evidence, states = rows.column("log_evidence").copy(), rows.column("object_states").copy()
        covariances = rows.column("object_covariances").copy()
        at, numbers = np.nonzero(rows.classes == MOVES)
        ids = rows.object_ids(self.object_ids)[at, numbers]
        for parent, prediction in enumerate(self.predictions):
            own = np.flatnonzero(rows.parents[at] == parent)
            if prediction.movers is None or not len(own):
                continue
            objects, detections, row = prediction.movers.movers.rows(ids[own]), numbers[own], at[own]
            observers = rows.observers(row)
            density = prediction.movers.log_densities(objects, detections, observers)[0]
            np.add.at(evidence, row, density)
            places, around = prediction.movers.places(detections, observers)
            states[row, detections], covariances[row, detections] = places, around
        return rows.gaining(log_evidence=evidence, object_states=states, object_covariances=covariances)

    @property
    def _suits_searches(self) -> bool:
        """Whether mode searches apply: noise as configured, independent detection errors and no outlier model."""
        settings = [component.noise_settings for component in self.parents.components]
        are_told = all(own is None or own.as_told for own in settings)
        are_plain = all(own.tail is None for own in self.pairs)
        return are_told and are_plain and all(own.errors is None for own in self.predictions)

    @property
    def _linearised(self) -> list[LinearisedEvidence]:
        return [self._linearised_of(parent) for parent in range(len(self.parents))]

    def _linearised_of(self, parent: int) -> LinearisedEvidence:
        return LinearisedEvidence.of(self.problem.spaces, self.predictions[parent], self.pairs[parent])

    def _searched(self, rows: Assignments) -> Assignments:
        """Assignments weighed at a mode that is searched for each of them."""
        objects = rows.objects if rows.classes is None else np.where(rows.classes == MOVES, -1, rows.objects)
        still = rows.gaining(objects=objects)
        problem = open_keyframe_problem(self.problem, self.detections, self.predictions, self.object_ids, still)
        mode = find_modes(problem, search_start(problem), tolerance=WEIGHING_TOLERANCE)
        found = WeighedAssociations(
            assignments=rows,
            object_ids=self.object_ids,
            log_left_out=np.zeros(0),
            problem=problem,
            mode=mode,
            num_new=len(self.born),
        )
        return found.at_modes().assignments.gaining(log_evidence=mode.log_evidence, bend=np.zeros(len(rows)))

    def _with_classes(self, candidates: WeighedAssociations) -> WeighedAssociations:
        """Candidates times the classes of the objects that they observe first, weighed at their modes."""
        rows = candidates.assignments
        problem = open_keyframe_problem(self.problem, self.detections, self.predictions, self.object_ids, rows)
        mode = find_modes(problem, search_start(problem))
        found = enumerate_classes(self._enumeration(), replace(candidates, problem=problem, mode=mode))
        assert found.problem is not None and found.start is not None
        mode = find_modes(found.problem, found.start)
        nothing = np.full(len(mode.y), np.nan)
        classed = replace(found, mode=mode).gaining(log_evidence=mode.log_evidence, effective_sample_sizes=nothing)
        return classed.at_modes()

    def _enumeration(self) -> EnumerationProblem:
        object_ids = self.object_ids.tolist()
        known = [[component.classes.get(n, -1) for n in object_ids] for component in self.parents.components]
        chosen = None
        if self.path is not None:
            wanted = [self.path.association[number] for number in self.used]
            objects = np.array([object_ids.index(n) if n >= 0 else -1 for n in wanted], dtype=int)
            chosen = (objects, np.array([self.path.class_assignment[number] for number in self.used], dtype=int))
        return EnumerationProblem(
            spaces=self.problem.spaces,
            model=self.problem.model,
            detections=self.detections,
            object_ids=self.object_ids,
            known_classes=np.array(known, dtype=int).reshape(len(self.parents), len(object_ids)),
            log_class_prior=self.registry.log_class_prior_of(object_ids),
            distinct=True,
            gate=self.problem.open_weights.gate if self.path is None else np.inf,
            max_candidates=candidate_limit(self.problem.open_weights, len(self.used)),
            path=chosen,
        )
