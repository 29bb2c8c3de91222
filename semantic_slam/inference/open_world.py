"""Continuations where the number of objects is unknown: a Poisson multi-Bernoulli mixture over SLAM hypotheses.

A detection is of an object that its hypothesis knows, or of none: then a new object starts, whose existence weighs
objects not detected so far against false alarms. Objects that should have been detected and were not lose existence,
and their hypothesis weight, by the same probabilities.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from semantic_slam.inference.component import Component, Held, LostComponentError
from semantic_slam.inference.continuation import Continuations
from semantic_slam.inference.enumeration import Enumerated, Setting, enumerate_classes
from semantic_slam.inference.existence import LEAST_PROBABILITY, missed
from semantic_slam.inference.gating import Chosen, Pairs, best_assignments, pair_densities
from semantic_slam.inference.gaussian import GaussianPrior
from semantic_slam.inference.growth import Outcome
from semantic_slam.inference.identity import hypothesis_id
from semantic_slam.inference.laplace import WEIGHING_TOLERANCE, find_modes, search_start
from semantic_slam.inference.linear_weights import Evaluated, Linear, joined
from semantic_slam.inference.objects import ObjectRegistry
from semantic_slam.inference.open_component import OpenComponent
from semantic_slam.inference.open_continuations import OpenContinuations
from semantic_slam.inference.open_growth import settled, stepped
from semantic_slam.inference.outlook import Lookout, Outlook
from semantic_slam.inference.population import Account
from semantic_slam.inference.problem import Problem
from semantic_slam.inference.protocol import LineageStep
from semantic_slam.inference.semantics import Moment, Views, Weighed
from semantic_slam.inference.sightlines import Shown, detection_probabilities
from semantic_slam.inference.small_problems import SmallProblems, evaluated
from semantic_slam.inference.stack import Rows
from semantic_slam.inference.step import Step

Array = NDArray[np.float64]
Index = NDArray[np.int_]

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
    pairs: list[Pairs]  # of each parent
    log_scores: Array  # (K,) estimates that only compare candidates of one parent
    log_left_out: Array  # (P,) relative to the parent's best


@dataclass(frozen=True)
class _Weighable:
    """K candidates with classes, where there are any, at their modes."""

    parents: Index  # (K,)
    steps: list[LineageStep]  # K
    result: Evaluated
    log_prior: Array  # (K,) of the classes first enumerated here
    semantics: Weighed
    log_left_out: Array  # (P,)


class OpenExpander:
    """Weighs continuations in an open world; a pure function of the problem, the registry and what it is given."""

    def __init__(self, problem: Problem, registry: ObjectRegistry):
        self.problem, self.registry, self.settings = problem, registry, problem.open_world
        self.lookout = Lookout(problem.model, problem.open_world)
        self.region = self.lookout.region

    def expand(
        self, step: Step, parent_ids: Sequence[int], held: Sequence[Held], path: LineageStep | None = None
    ) -> OpenContinuations:
        """Continuations of every parent, or of one along ``path`` alone. Raises LostComponentError."""
        components = [item.component for item in held]
        outlooks = [self.lookout.outlook(component, step.motion, step.detections) for component in components]
        candidates = self._candidates(step, outlooks, path)
        if self.problem.model.num_classes > 0 and len(step.detections):
            weighable = self._with_classes(step, outlooks, candidates, components, path)
        else:
            weighable = self._geometric(step, outlooks, candidates)
        if step.index == 0:
            weighable = _with_noise(weighable, [outlook.component.noise for outlook in outlooks])
        return self._weighed(step, parent_ids, outlooks, weighable, candidates.pairs)

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

    def _candidates(self, step: Step, outlooks: list[Outlook], path: LineageStep | None) -> _Candidates:
        model = self.problem.model
        pairs = [
            pair_densities(model, step.detections, outlook.predicted.mean[0], outlook.predicted.covariance[0])
            for outlook in outlooks
        ]
        if path is not None:
            chosen = [Chosen(self._columns(step, outlooks[0], path), np.zeros(1), -np.inf)]
        else:
            chosen = [self.assignments(outlook, own) for outlook, own in zip(outlooks, pairs, strict=True)]
        parents = np.repeat(np.arange(len(outlooks)), [len(item.columns) for item in chosen])
        columns, scores = (
            np.concatenate([getattr(item, name) for item in chosen]) for name in ("columns", "log_scores")
        )
        return _Candidates(parents, columns, pairs, scores, np.array([item.log_left_out for item in chosen]))

    def assignments(self, outlook: Outlook, pairs: Pairs) -> Chosen:
        """The joint assignments of one parent that are weighed."""
        r, detected = outlook.population.existence[outlook.near], outlook.detected[outlook.near]
        with np.errstate(divide="ignore"):
            log_ratio = np.log(r * np.maximum(detected, self._least_detected)) - missed(r, detected)[0]
        log_new = outlook.log_intensity + np.array([birth.log_area for birth in outlook.births])
        return best_assignments(
            pairs.log_density + log_ratio,
            pairs.distance < self.settings.gate_sigma,
            log_new,
            self.problem.weights.max_candidates,
            self.problem.weights.gate,
            outlook.log_beyond,
        )

    def _columns(self, step: Step, outlook: Outlook, path: LineageStep) -> Index:
        """(1, D) columns of a lineage's association."""
        near = outlook.population.ids[outlook.near].tolist()
        place = {n: column for column, n in enumerate([*near, *self._born(step).tolist()])}
        if not place.keys() >= set(path.association):
            raise LostComponentError("a lineage names an object that its hypothesis does not know")
        return np.array([place[n] for n in path.association], dtype=int).reshape(1, -1)

    @property
    def _least_detected(self) -> float:
        return LEAST_DETECTION_SHARE * self.region.detection_probability

    def _ids(self, step: Step, outlooks: list[Outlook], candidates: _Candidates) -> Index:
        """(K, D) object ids."""
        by_parent = [np.concatenate([outlook.near_ids, self._born(step)]) for outlook in outlooks]
        ids = [by_parent[p][own] for p, own in zip(candidates.parents, candidates.columns, strict=True)]
        return np.array(ids, dtype=int).reshape(candidates.columns.shape)

    def _geometric(self, step: Step, outlooks: list[Outlook], candidates: _Candidates) -> _Weighable:
        """Assignments alone: by one linearisation, and by a search of their own for those that bend."""
        turns = np.sqrt([d.covariance[1, 1] if d.has_range else np.inf for d in step.detections])
        parts: list[Evaluated] = []
        bent: list[int] = []
        for parent, (outlook, pairs) in enumerate(zip(outlooks, candidates.pairs, strict=True)):
            rows = np.flatnonzero(candidates.parents == parent)
            mean, covariance = outlook.predicted.mean[0], outlook.predicted.covariance[0]
            linear = Linear(self.problem.manifold, mean, covariance, pairs, outlook.births, turns)
            part = linear.evaluate(candidates.columns[rows])
            likely = candidates.log_scores[rows] >= candidates.log_scores[rows].max() - UNLIKELY
            bent += rows[(part.bend > LARGEST_BEND) & likely].tolist()
            parts.append(part)
        result, ids = joined(parts), self._ids(step, outlooks, candidates)
        if bent and len(step.detections):
            chosen = np.array(bent)
            small = self._small(step, outlooks, candidates.parents[chosen], ids[chosen])
            mode = find_modes(small.stack, search_start(small.stack), tolerance=WEIGHING_TOLERANCE)
            result = result.replaced(chosen, evaluated(small.stack, mode))
        none = (-1,) * len(step.detections)
        steps = [LineageStep(tuple(row), none) for row in ids.tolist()]
        semantics = self._carried(step, outlooks, candidates.parents, ids, result)
        return _Weighable(candidates.parents, steps, result, np.zeros(len(steps)), semantics, candidates.log_left_out)

    def _carried(self, step: Step, outlooks: list[Outlook], parents: Index, ids: Index, result: Evaluated) -> Weighed:
        """What views say of associations (K, D) under carried classes; nothing where there are no class models."""
        count, semantics = len(parents), self.problem.carried
        if semantics is None or not len(step.detections):
            return Weighed.silent(count)
        numbers = np.unique(ids).tolist()
        prior = dict(zip(numbers, self.registry.log_class_prior_of(numbers), strict=True))
        components = [outlook.component for outlook in outlooks]
        populations = [outlook.population for outlook in outlooks]
        views = Views(
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

    def _small(self, step: Step, outlooks: list[Outlook], parents: Index, ids: Index) -> SmallProblems:
        return SmallProblems.of(self.problem, step, outlooks, self._born(step), parents, ids)

    def _with_classes(
        self,
        step: Step,
        outlooks: list[Outlook],
        candidates: _Candidates,
        components: Sequence[Component],
        path: LineageStep | None,
    ) -> _Weighable:
        """Assignments times the classes of the objects that they observe first."""
        small = self._small(step, outlooks, candidates.parents, self._ids(step, outlooks, candidates))
        mode = find_modes(small.stack, search_start(small.stack))
        setting = self._setting(step, small.object_ids, components, path)
        none = np.zeros(len(mode.y))
        geometric = Enumerated(small.stack, mode.y, mode.log_evidence, none, candidates.log_left_out)
        found = enumerate_classes(setting, geometric)
        stack = found.stack
        mode = find_modes(stack, found.start)
        used, prior = np.arange(len(step.detections)), setting.log_class_prior
        births = self._priors(step, outlooks)
        semantics = Weighed.silent(len(mode.y))
        if self.problem.semantics is not None:
            moment = Moment(step, components, stack, mode, used, small.object_ids, prior, births)
            semantics = self.problem.semantics.weigh(moment)
        steps = _lineage_steps(stack.rows, small.object_ids)
        result = evaluated(stack, mode)
        return _Weighable(stack.rows.parents, steps, result, found.log_class_prior, semantics, found.log_left_out)

    def _priors(self, step: Step, outlooks: list[Outlook]) -> list[dict[int, GaussianPrior]]:
        born = self._born(step).tolist()
        return [{n: own.prior for n, own in zip(born, outlook.births, strict=True)} for outlook in outlooks]

    def _setting(
        self, step: Step, object_ids: list[int], components: Sequence[Component], path: LineageStep | None
    ) -> Setting:
        known = [[component.classes.get(n, -1) for n in object_ids] for component in components]
        chosen = None
        if path is not None:
            objects = np.array([object_ids.index(n) for n in path.association], dtype=int)
            chosen = (objects, np.array(path.class_assignment, dtype=int))
        return Setting(
            self.problem.manifold,
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
        outlooks: list[Outlook],
        found: _Weighable,
        pairs: list[Pairs],
    ) -> OpenContinuations:
        result, parents = found.result, found.parents
        ids = [
            hypothesis_id(parent_ids[p], step.stamp_ns, s.association, s.class_assignment, s.mode)
            for p, s in zip(parents, found.steps, strict=True)
        ]
        factors, accounts = self._existence(step, outlooks, found)
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
            new_objects=self._priors(step, outlooks),
            records=found.semantics.records,
            robot_corrections=found.semantics.robot,
            refined=[None] * len(ids),
            histories=[None] * len(ids),
            accounts=accounts,
            outlooks=outlooks,
            pairs=pairs,
        )

    def _existence(self, step: Step, outlooks: list[Outlook], found: _Weighable) -> tuple[Array, list[Account]]:
        """(K,) log factors of births, detections and misses, and what becomes of the objects' existence."""
        expected = self.settings.clutter_per_frame
        expected += self.region.detection_probability * self.settings.birth_density * self.region.area_m2
        factors = np.full(len(found.steps), -expected)
        accounts: list[Account | None] = [None] * len(found.steps)
        born = self._born(step)
        for parent, outlook in enumerate(outlooks):
            rows = np.flatnonzero(found.parents == parent)
            detected = self._detected(step, outlook, found.result, rows)
            log_missed, after = missed(outlook.population.existence, detected)
            for at, row in enumerate(rows):
                own = at if len(detected) > 1 else 0
                association = np.array(found.steps[row].association, dtype=int)
                if_missed = detected[own], log_missed[own], after[own].copy()
                added, accounts[row] = self._account(outlook, association, born, *if_missed)
                factors[row] += added
        return factors, [account for account in accounts if account is not None]

    def _detected(self, step: Step, outlook: Outlook, result: Evaluated, rows: Index) -> Array:
        """(K, O) detection probabilities at the modes; (1, O) at the prediction where that tells as much."""
        if not outlook.is_lost and self.region.occluder_radius_m <= 0.0:
            return outlook.detected[None]
        ranges = np.array([detection.range_m for detection in step.detections], dtype=np.float64)
        bearings = np.array([detection.bearing_rad for detection in step.detections], dtype=np.float64)
        shown = Shown(ranges, bearings, step.sight)
        detected = np.zeros((len(rows), len(outlook.detected)))
        robot, covariance = result.robot[rows], result.robot_covariance[rows]
        detected[:, outlook.in_reach] = detection_probabilities(
            self.region, outlook.prediction, robot, covariance, shown
        )
        return detected

    def _account(
        self, outlook: Outlook, association: Index, born: Index, detected: Array, log_missed: Array, after: Array
    ) -> tuple[float, Account]:
        """Log factor and account of one continuation.

        Of its parent's objects: (O,) probabilities of being ``detected``, log factors of not being, and existence
        ``after`` that, which is used up.
        """
        is_new = association >= born[0] if len(born) else np.zeros(0, dtype=bool)
        population = outlook.population
        observed = population.rows(association[~is_new])
        least = np.maximum(detected[observed], self._least_detected)
        found = np.log(np.maximum(population.existence[observed] * least, LEAST_PROBABILITY))
        total = float(log_missed.sum() + (found - log_missed[observed]).sum())
        after[observed] = 1.0
        new = np.flatnonzero(is_new)
        total += sum(outlook.births[n].log_area - outlook.births[n].log_stand_in for n in new)
        total += float(outlook.log_intensity[new].sum())
        kept = after >= self.settings.least_existence
        return total, Account(after, kept, association[new], outlook.birth_existence[new])


def _with_noise(found: _Weighable, noises: list[int]) -> _Weighable:
    """The first steps of lineages, which say under which noise of odometry these began."""
    steps = [replace(step, mode=noises[parent]) for step, parent in zip(found.steps, found.parents, strict=True)]
    return replace(found, steps=steps)


def _lineage_steps(rows: Rows, object_ids: Sequence[int]) -> list[LineageStep]:
    association = np.array(object_ids, dtype=int)[rows.objects]
    classes = np.full_like(association, -1) if rows.classes is None else rows.classes
    return [LineageStep(tuple(a), tuple(c)) for a, c in zip(association.tolist(), classes.tolist(), strict=True)]
