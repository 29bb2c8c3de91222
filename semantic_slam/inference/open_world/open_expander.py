"""Continuations where the number of objects is unknown: a Poisson multi-Bernoulli mixture over SLAM hypotheses.

A detection is of an object that its hypothesis knows, or of none: then a new object starts, whose existence weighs
objects not detected so far against false alarms. Objects that should have been detected and were not lose existence,
and their hypothesis weight, by the same probabilities.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.association.enumeration import EnumeratedAssignments, EnumerationProblem, enumerate_classes
from semantic_slam.inference.association.gating import (
    PairDensities,
    RankedAssignments,
    best_assignments,
    pair_densities,
)
from semantic_slam.inference.evidence.keyframe_problem import Assignments, search_start
from semantic_slam.inference.evidence.laplace import WEIGHING_TOLERANCE, find_modes
from semantic_slam.inference.expander import Continuations
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.objects import ObjectRegistry
from semantic_slam.inference.open_world.detection_probability import Occluders, detection_probabilities
from semantic_slam.inference.open_world.existence import LEAST_PROBABILITY, missed
from semantic_slam.inference.open_world.keyframe_problems import OpenKeyframeProblem, at_modes
from semantic_slam.inference.open_world.linear_evidence import EvaluatedAssignments, LinearisedEvidence, joined
from semantic_slam.inference.open_world.open_continuations import OpenContinuations
from semantic_slam.inference.open_world.open_growth import settled, stepped
from semantic_slam.inference.open_world.prediction import Prediction, Predictor
from semantic_slam.inference.problem import Problem
from semantic_slam.inference.semantics.interface import CarriedInput, SemanticEvidence, SemanticInput
from semantic_slam.inference.smoothing.component import Component, LostComponentError, WeightedComponent
from semantic_slam.inference.smoothing.growth import Outcome
from semantic_slam.inference.smoothing.open_component import OpenComponent
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.identity import hypothesis_id
from semantic_slam.inference.states.lineage import LineageStep
from semantic_slam.inference.states.object_table import ExistenceUpdate

LEAST_DETECTION_SHARE = 0.02
"""Of the detection probability, for objects that were detected although they seem to lie outside the region."""
UNLIKELY = 10.0
"""Nats behind the best of its parent from which on a candidate is weighed by the linearisation whatever it bends."""
LARGEST_BEND = 0.3
"""Sigmas of second order in a measurement from which on its assignment is weighed at its own mode."""


@dataclass(frozen=True)
class _Candidates:
    """K joint assignments of all parents."""

    parents: Index  # (K,)
    columns: Index  # (K, D) into the near objects of the parent, M + i: a new object
    pairs: list[PairDensities]  # of each parent
    log_scores: Array  # (K,) estimates that only compare candidates of one parent
    log_left_out: Array  # (P,) relative to the parent's best


@dataclass(frozen=True)
class _Weighable:
    """K candidates with classes, where there are any, at their modes."""

    parents: Index  # (K,)
    steps: list[LineageStep]  # K
    result: EvaluatedAssignments
    log_prior: Array  # (K,) of the classes first enumerated here
    semantics: SemanticEvidence
    log_left_out: Array  # (P,)


class OpenExpander:
    """Weighs continuations in an open world; a pure function of the problem, the registry and what it is given."""

    def __init__(self, problem: Problem, registry: ObjectRegistry):
        self.problem, self.registry, self.settings = problem, registry, problem.open_world
        self.predictor = Predictor(problem.model, problem.open_world)
        self.region = self.predictor.region

    def expand(
        self, step: Step, parent_ids: Sequence[int], held: Sequence[WeightedComponent], path: LineageStep | None = None
    ) -> OpenContinuations:
        """Continuations of every parent, or of one along ``path`` alone. Raises LostComponentError."""
        components = [item.component for item in held]
        predictions = [self.predictor.predict(component, step.motion, step.detections) for component in components]
        candidates = self._candidates(step, predictions, path)
        if self.problem.model.num_classes > 0 and len(step.detections):
            weighable = self._with_classes(step, predictions, candidates, components, path)
        else:
            weighable = self._geometric(step, predictions, candidates)
        if step.index == 0:
            weighable = _with_noise(weighable, [prediction.component.noise for prediction in predictions])
        return self._weighed(step, parent_ids, predictions, weighable, candidates.pairs)

    def root(self, number: int) -> OpenComponent:
        """The component before any keyframe, under the odometry noise of that number."""
        return OpenComponent.before_any_keyframe(self.problem, number)

    def grow(
        self, step: Step, found: Continuations, parents: Sequence[Component], at: Sequence[int], *, in_place: bool
    ) -> list[Outcome]:
        """The components of the continuations ``at``, each from its own of ``parents``.

        ``in_place``: nobody needs the parents again, and a child may use its own up.
        """
        assert isinstance(found, OpenContinuations)
        own = cast(Sequence[OpenComponent], parents)
        records = zip(at, found.records(at), strict=True)
        added = [found.added(step, one, views, settle=self.settings.settle) for one, views in records]
        grow = settled if self.settings.settle else stepped
        return grow(own, step.motion, added, self.settings.max_joint_objects, in_place=in_place)

    def _born(self, step: Step) -> Index:
        """(D,) ids of the objects that the detections would start: a function of the keyframes so far."""
        return self.registry.first_new_id(step.index) + np.arange(len(step.detections))

    def _candidates(self, step: Step, predictions: list[Prediction], path: LineageStep | None) -> _Candidates:
        spaces, model = self.problem.spaces, self.problem.model
        pairs = [
            pair_densities(spaces, model, step.detections, own.predicted.mean[0], own.predicted.covariance[0])
            for own in predictions
        ]
        if path is not None:
            chosen = [RankedAssignments(self._columns(step, predictions[0], path), np.zeros(1), -np.inf)]
        else:
            chosen = [self.assignments(prediction, own) for prediction, own in zip(predictions, pairs, strict=True)]
        parents = np.repeat(np.arange(len(predictions)), [len(item.columns) for item in chosen])
        columns, scores = (
            np.concatenate([getattr(item, name) for item in chosen]) for name in ("columns", "log_scores")
        )
        return _Candidates(parents, columns, pairs, scores, np.array([item.log_left_out for item in chosen]))

    def assignments(self, prediction: Prediction, pairs: PairDensities) -> RankedAssignments:
        """The joint assignments of one parent that are weighed."""
        r, detected = prediction.population.existence[prediction.near], prediction.detected[prediction.near]
        with np.errstate(divide="ignore"):
            log_ratio = np.log(r * np.maximum(detected, self._least_detected)) - missed(r, detected)[0]
        log_new = prediction.log_intensity + np.array([birth.log_area for birth in prediction.births])
        return best_assignments(
            pairs.log_density + log_ratio,
            pairs.distance < self.settings.gate_sigma,
            log_new,
            self.problem.weights.max_candidates,
            self.problem.weights.gate,
            prediction.log_beyond,
        )

    def _columns(self, step: Step, prediction: Prediction, path: LineageStep) -> Index:
        """(1, D) columns of a lineage's association."""
        near = prediction.population.ids[prediction.near].tolist()
        place = {n: column for column, n in enumerate([*near, *self._born(step).tolist()])}
        if not place.keys() >= set(path.association):
            raise LostComponentError("a lineage names an object that its hypothesis does not know")
        return np.array([place[n] for n in path.association], dtype=int).reshape(1, -1)

    @property
    def _least_detected(self) -> float:
        return LEAST_DETECTION_SHARE * self.region.detection_probability

    def _ids(self, step: Step, predictions: list[Prediction], candidates: _Candidates) -> Index:
        """(K, D) object ids."""
        by_parent = [np.concatenate([prediction.near_ids, self._born(step)]) for prediction in predictions]
        ids = [by_parent[p][own] for p, own in zip(candidates.parents, candidates.columns, strict=True)]
        return np.array(ids, dtype=int).reshape(candidates.columns.shape)

    def _geometric(self, step: Step, predictions: list[Prediction], candidates: _Candidates) -> _Weighable:
        """Assignments alone: by one linearisation, and by a search of their own for those that bend."""
        turns = np.sqrt([d.covariance[1, 1] if d.has_range else np.inf for d in step.detections])
        parts: list[EvaluatedAssignments] = []
        bent: list[int] = []
        for parent, (prediction, pairs) in enumerate(zip(predictions, candidates.pairs, strict=True)):
            rows = np.flatnonzero(candidates.parents == parent)
            mean, covariance = prediction.predicted.mean[0], prediction.predicted.covariance[0]
            linear = LinearisedEvidence(self.problem.spaces, mean, covariance, pairs, prediction.births, turns)
            part = linear.evaluate(candidates.columns[rows])
            likely = candidates.log_scores[rows] >= candidates.log_scores[rows].max() - UNLIKELY
            bent += rows[(part.bend > LARGEST_BEND) & likely].tolist()
            parts.append(part)
        result, ids = joined(parts), self._ids(step, predictions, candidates)
        if bent and len(step.detections):
            chosen = np.array(bent)
            small = self._small(step, predictions, candidates.parents[chosen], ids[chosen])
            mode = find_modes(small.stack, search_start(small.stack), tolerance=WEIGHING_TOLERANCE)
            result = result.replaced(chosen, at_modes(small.stack, mode))
        none = (-1,) * len(step.detections)
        steps = [LineageStep(tuple(row), none) for row in ids.tolist()]
        semantics = self._carried(step, predictions, candidates.parents, ids, result)
        return _Weighable(candidates.parents, steps, result, np.zeros(len(steps)), semantics, candidates.log_left_out)

    def _carried(
        self, step: Step, predictions: list[Prediction], parents: Index, ids: Index, result: EvaluatedAssignments
    ) -> SemanticEvidence:
        """What views say of associations (K, D) under carried classes; nothing where there are no class models."""
        count, semantics = len(parents), self.problem.carried
        if semantics is None or not len(step.detections):
            return SemanticEvidence.silent(count)
        numbers = np.unique(ids).tolist()
        prior = dict(zip(numbers, self.registry.log_class_prior_of(numbers), strict=True))
        components = [prediction.component for prediction in predictions]
        populations = [prediction.population for prediction in predictions]
        views = CarriedInput(
            step.detections,
            step.in_coverage,
            components,
            populations,
            parents,
            ids,
            result.robot,
            result.objects,
            prior,
            step.index,
            result.robot_covariance,
        )
        return semantics.carried(views)

    def _small(self, step: Step, predictions: list[Prediction], parents: Index, ids: Index) -> OpenKeyframeProblem:
        return OpenKeyframeProblem.of(self.problem, step, predictions, self._born(step), parents, ids)

    def _with_classes(
        self,
        step: Step,
        predictions: list[Prediction],
        candidates: _Candidates,
        components: Sequence[Component],
        path: LineageStep | None,
    ) -> _Weighable:
        """Assignments times the classes of the objects that they observe first."""
        small = self._small(step, predictions, candidates.parents, self._ids(step, predictions, candidates))
        mode = find_modes(small.stack, search_start(small.stack))
        setting = self._setting(step, small.object_ids, components, path)
        none = np.zeros(len(mode.y))
        geometric = EnumeratedAssignments(small.stack, mode.y, mode.log_evidence, none, candidates.log_left_out)
        found = enumerate_classes(setting, geometric)
        stack = found.stack
        mode = find_modes(stack, found.start)
        used, prior = np.arange(len(step.detections)), setting.log_class_prior
        births = self._priors(step, predictions)
        semantics = SemanticEvidence.silent(len(mode.y))
        if self.problem.semantics is not None:
            moment = SemanticInput(step, components, stack, mode, used, small.object_ids, prior, births)
            semantics = self.problem.semantics.weigh(moment)
        steps = _lineage_steps(stack.rows, small.object_ids)
        result = at_modes(stack, mode)
        return _Weighable(stack.rows.parents, steps, result, found.log_class_prior, semantics, found.log_left_out)

    def _priors(self, step: Step, predictions: list[Prediction]) -> list[dict[int, GaussianPrior]]:
        born = self._born(step).tolist()
        return [{n: own.prior for n, own in zip(born, prediction.births, strict=True)} for prediction in predictions]

    def _setting(
        self, step: Step, object_ids: list[int], components: Sequence[Component], path: LineageStep | None
    ) -> EnumerationProblem:
        known = [[component.classes.get(n, -1) for n in object_ids] for component in components]
        chosen = None
        if path is not None:
            objects = np.array([object_ids.index(n) for n in path.association], dtype=int)
            chosen = (objects, np.array(path.class_assignment, dtype=int))
        return EnumerationProblem(
            self.problem.spaces,
            self.problem.model,
            step.detections,
            np.array(known, dtype=int).reshape(len(components), len(object_ids)),
            self.registry.log_class_prior_of(object_ids),
            True,
            self.problem.weights.gate if path is None else np.inf,
            self.problem.weights.max_candidates,
            chosen,
        )

    def _weighed(
        self,
        step: Step,
        parent_ids: Sequence[int],
        predictions: list[Prediction],
        found: _Weighable,
        pairs: list[PairDensities],
    ) -> OpenContinuations:
        result, parents = found.result, found.parents
        ids = [
            hypothesis_id(parent_ids[p], step.stamp_ns, s.association, s.class_assignment, s.mode)
            for p, s in zip(parents, found.steps, strict=True)
        ]
        factors, accounts = self._existence(step, predictions, found)
        log_psi = result.log_evidence + found.log_prior + found.semantics.log_weights + factors
        best = np.full(len(parent_ids), -np.inf)
        np.maximum.at(best, parents, log_psi)
        return OpenContinuations(
            ids=ids,
            parents=parents,
            steps=found.steps,
            log_psi=log_psi,
            effective_sample_sizes=found.semantics.effective_sample_sizes,
            robot=result.robot,
            robot_covariance=result.robot_covariance,
            objects=result.objects,
            object_covariances=result.object_covariances,
            used=np.arange(len(step.detections)),
            log_left_out=found.log_left_out + best,
            new_objects=self._priors(step, predictions),
            records=found.semantics.records,
            robot_corrections=found.semantics.robot,
            refined=[None] * len(ids),
            histories=[None] * len(ids),
            accounts=accounts,
            predictions=predictions,
            pairs=pairs,
        )

    def _existence(
        self, step: Step, predictions: list[Prediction], found: _Weighable
    ) -> tuple[Array, list[ExistenceUpdate]]:
        """(K,) log factors of births, detections and misses, and what becomes of the objects' existence."""
        expected = self.settings.clutter_per_frame
        expected += self.region.detection_probability * self.settings.birth_density * self.region.area_m2
        factors = np.full(len(found.steps), -expected)
        accounts: list[ExistenceUpdate | None] = [None] * len(found.steps)
        born = self._born(step)
        for parent, prediction in enumerate(predictions):
            rows = np.flatnonzero(found.parents == parent)
            detected = self._detected(step, prediction, found.result, rows)
            log_missed, after = missed(prediction.population.existence, detected)
            for at, row in enumerate(rows):
                own = at if len(detected) > 1 else 0
                association = np.array(found.steps[row].association, dtype=int)
                if_missed = detected[own], log_missed[own], after[own].copy()
                added, accounts[row] = self._account(prediction, association, born, *if_missed)
                factors[row] += added
        return factors, [account for account in accounts if account is not None]

    def _detected(self, step: Step, prediction: Prediction, result: EvaluatedAssignments, rows: Index) -> Array:
        """(K, O) detection probabilities at the modes; (1, O) at the prediction where that tells as much."""
        if not prediction.is_lost and self.region.occluder_radius_m <= 0.0:
            return prediction.detected[None]
        ranges = np.array([detection.range_m for detection in step.detections], dtype=np.float64)
        bearings = np.array([detection.bearing_rad for detection in step.detections], dtype=np.float64)
        shown = Occluders(ranges, bearings, step.free_range_scan)
        detected = np.zeros((len(rows), len(prediction.detected)))
        robot, covariance = result.robot[rows], result.robot_covariance[rows]
        detected[:, prediction.in_reach] = detection_probabilities(
            self.region, prediction.prediction, robot, covariance, shown
        )
        return detected

    def _account(
        self, prediction: Prediction, association: Index, born: Index, detected: Array, log_missed: Array, after: Array
    ) -> tuple[float, ExistenceUpdate]:
        """Log factor and account of one continuation.

        Of its parent's objects: (O,) probabilities of being ``detected``, log factors of not being, and existence
        ``after`` that, which is used up.
        """
        is_new = association >= born[0] if len(born) else np.zeros(0, dtype=bool)
        population = prediction.population
        observed = population.rows(association[~is_new])
        least = np.maximum(detected[observed], self._least_detected)
        found = np.log(np.maximum(population.existence[observed] * least, LEAST_PROBABILITY))
        total = float(log_missed.sum() + (found - log_missed[observed]).sum())
        after[observed] = 1.0
        new = np.flatnonzero(is_new)
        total += sum(prediction.births[n].log_area - prediction.births[n].log_stand_in for n in new)
        total += float(prediction.log_intensity[new].sum())
        kept = after >= self.settings.least_existence
        return total, ExistenceUpdate(after, kept, association[new], prediction.birth_existence[new])


def _with_noise(found: _Weighable, noises: list[int]) -> _Weighable:
    """The first steps of lineages, which say under which noise of odometry these began."""
    steps = [replace(step, mode=noises[parent]) for step, parent in zip(found.steps, found.parents, strict=True)]
    return replace(found, steps=steps)


def _lineage_steps(rows: Assignments, object_ids: Sequence[int]) -> list[LineageStep]:
    association = np.array(object_ids, dtype=int)[rows.objects]
    classes = np.full_like(association, -1) if rows.classes is None else rows.classes
    return [LineageStep(tuple(a), tuple(c)) for a, c in zip(association.tolist(), classes.tolist(), strict=True)]
