"""Expansion of a keyframe in a closed world: every parent has all objects, predicted as one joint Gaussian."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.inference.association.candidate_limit import candidate_limit
from semantic_slam.inference.association.closed_prediction import log_levels, predict
from semantic_slam.inference.association.elsewhere import also_gone, exclusive_objects, possible_objects
from semantic_slam.inference.association.enumeration import (
    EnumerationProblem,
    enumerate_associations,
    enumerate_classes,
    fixed_association,
)
from semantic_slam.inference.association.first_views import log_first_inliers
from semantic_slam.inference.association.map_gate import FEW_OBJECTS, MapGate, map_gate
from semantic_slam.inference.association.placeholders import (
    Placeholders,
    free_placeholders,
    log_num_labellings,
    num_free_placeholders,
)
from semantic_slam.inference.association.strategy import Parents
from semantic_slam.inference.evidence.assignments import Assignments
from semantic_slam.inference.evidence.laplace import WEIGHING_TOLERANCE, find_modes
from semantic_slam.inference.evidence.mode_splitting import UnsplitCandidates, split_modes
from semantic_slam.inference.evidence.prior_samples import sample_evidence
from semantic_slam.inference.evidence.weighed_associations import WeighedAssociations
from semantic_slam.inference.models.observation import ModelsOutliers
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.semantics.interface import SemanticInput
from semantic_slam.inference.smoothing.component_update import ComponentUpdate
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.identity import generator, hypothesis_id
from semantic_slam.inference.states.lineage import LineageStep
from semantic_slam.inference.states.tracked_objects import ExistenceUpdate, HypothesisObjects
from semantic_slam.inference.world.objects import ObjectRegistry
from semantic_slam.inference.world.problem import Problem


@dataclass(frozen=True, kw_only=True)
class ClosedKeyframe:
    """A keyframe predicted for P parents in a closed world; implements ``PredictedKeyframe``.

    Each of the n used detections is of a known object, of one that this keyframe introduces by name, or clutter.
    """

    problem: Problem
    registry: ObjectRegistry
    step: Step
    parents: Parents
    path: LineageStep | None  # the one continuation wanted, when a lineage is replayed
    used: Index  # (n,) indices of the detections that are associated
    known: Sequence[int]  # ids of the known objects that detections may be of
    identities: Sequence[int] | None = None  # n object ids, where detections carry identities
    log_clutter: Array | None = None  # (n,) log of odds x density as clutter; None: every detection is of an object
    new: Sequence[dict[int, GaussianPrior]] = field(default_factory=tuple)  # P: priors of newly introduced objects

    @property
    def expected_births(self) -> Array:
        """(P,) zeros: a closed world expects no births."""
        return np.zeros(len(self.parents))

    def associate(self) -> WeighedAssociations:
        """Enumerate the associations, on a large map within a gate that is widened until the result justifies it.

        The gate leaves out objects that no detection can be of, see ``MapGate``.
        """
        gate = self._map_gate()
        while True:
            near = self.known if gate is None else [self.known[i] for i in gate.columns()]
            candidates = self._associated(near, gate)
            if gate is None:
                return candidates
            best = self._best(candidates)
            wider = gate.widened(best, self.problem.weights.gate)
            if wider is None:
                left_out = np.logaddexp(candidates.log_left_out, gate.log_left_out(best))
                return replace(candidates, log_left_out=left_out)
            gate = wider

    def weigh(self, candidates: WeighedAssociations) -> WeighedAssociations:
        """Enumerate classes, find modes and compute the evidence; multimodal candidates are split into their modes."""
        if self.problem.model.num_classes > 0 and len(self.used):
            candidates = self._with_classes(candidates)
        return replace(self._with_evidence(candidates), num_new=len(self._new[0])).at_modes()

    def semantic_input(self, candidates: WeighedAssociations) -> SemanticInput:
        """The semantics' input: the candidates, with the class priors that the map states."""
        return SemanticInput(
            step=self.step,
            parents=self.parents.components,
            candidates=candidates,
            used=self.used,
            log_class_prior=self._log_class_prior(candidates.object_ids),
            new=self._new,
        )

    def existence(self, candidates: WeighedAssociations) -> tuple[Array, Sequence[ExistenceUpdate]]:
        """Log factors and existence updates: misses do not count in a closed world, and named objects surely exist.

        The factors hold the scores of clutter. A placeholder for an unmapped object, or a displaced twin, exists once
        it is detected; the factor of its first detection is its prior probability of existence, times the number of
        placeholders that it may take.
        """
        factors = np.zeros(len(candidates.assignments))
        if self.log_clutter is not None and self.problem.clutter is not None:
            scores = self.problem.clutter.log_scores([self.step.detections[i] for i in self.used])
            factors = np.where(candidates.assignments.objects < 0, scores, 0.0).sum(axis=1)
        unchanged = [
            ExistenceUpdate.starting(component.objects, list(new))
            for component, new in zip(self.parents.components, self._new, strict=True)
        ]
        updates = [unchanged[parent] for parent in candidates.assignments.parents.tolist()]
        if not len(self._uncertain):
            return factors, updates
        detected = candidates.assignments.object_ids(candidates.object_ids)
        for row, (parent, update) in enumerate(zip(candidates.assignments.parents.tolist(), updates, strict=True)):
            objects = self.parents.components[parent].objects
            known = objects.ids[:, None]
            seen = (known == self._uncertain).any(axis=1) & (known == detected[row]).any(axis=1)
            if not seen.any():
                continue
            factors[row] += float(np.log(objects.existence[seen]).sum()) + self._log_labellings(objects, seen)
            updates[row] = update.detecting(seen, also_gone(self.problem.displaced, objects.ids, seen))
        return factors, updates

    def _log_labellings(self, objects: HypothesisObjects, seen: Flags) -> float:
        """Log number of the ways in which the (O,) objects ``seen`` may be the placeholders of a hypothesis."""
        free = free_placeholders(objects, self.problem.unmapped_ids)
        return log_num_labellings(int(free.sum()), int((free & seen).sum()))

    def updates(
        self, candidates: WeighedAssociations, rows: Sequence[int], existence: Sequence[ExistenceUpdate]
    ) -> list[ComponentUpdate]:
        """One component update for each candidate in ``rows``, without the records of the semantics."""
        some = candidates.assignments.take(np.array(rows, dtype=int))
        parents = [self.parents.components[parent] for parent in some.parents]
        robots = np.array([parent.newest_robot() for parent in parents])
        predicted = self.problem.spaces.robot.compose(robots, self.step.motion.control)
        steps = replace(candidates, assignments=some).steps(self.used, len(self.step.names))
        return [
            self._update(some, row, steps[row], predicted[row], existence[number]) for row, number in enumerate(rows)
        ]

    def _update(
        self,
        own: Assignments,
        row: int,
        taken: LineageStep,
        predicted: Array,
        existence: ExistenceUpdate,
    ) -> ComponentUpdate:
        mode = own.posterior_modes[row] if own.posterior_modes is not None else None
        return ComponentUpdate(
            observed=self.step.observed(taken.association, taken.class_assignment, self.used),
            objects=own.column("object_states")[row][own.objects[row] >= 0],
            robot=own.column("robot")[row],
            predicted=predicted,
            new_objects=self._new[own.parents[row]],
            existence=existence,
            window=own.windows[row] if own.windows is not None else None,
            smoothed=mode.smoothed if mode is not None else {},
            corrections=mode.corrections if mode is not None else {},
        )

    @cached_property
    def _uncertain(self) -> Index:
        """Ids of objects of uncertain existence: placeholders of unmapped ones, displaced twins and their partners."""
        return np.array(sorted(self.problem.unmapped_ids | self.problem.displaced.partner.keys()), dtype=int)

    @property
    def _new(self) -> Sequence[dict[int, GaussianPrior]]:
        return self.new or [{}] * len(self.parents)

    def _map_gate(self) -> MapGate | None:
        """The gate on a large map; None: all objects are considered."""
        gate, prior = self.problem.weights.gate, {entry.object_id: entry.prior for entry in self.problem.objects}
        everything = self.identities is not None or self.path is not None or len(self.known) <= FEW_OBJECTS
        if everything or not len(self.used) or not np.isfinite(gate):
            return None
        objects = [(number, prior[number].covariance) for number in self.known]
        detections = [self.step.detections[i] for i in self.used]
        spaces, model = self.problem.spaces, self.problem.model
        found = map_gate(spaces, model, self.step, detections, self.parents.components, objects, gate)
        return replace(found, has_clutter=self.log_clutter is not None, num_alike=self._num_alike)

    @property
    def _num_alike(self) -> Index | None:
        """(P,) free placeholders that a detection cannot be of, as the first one is before them; None: all are options.

        Without distinct assignment a detection may be of one that another detection of the frame has taken.
        """
        if len(self.problem.unmapped_ids) < 2 or not self.problem.distinct:
            return None
        num_free = num_free_placeholders(self.parents.components, self.problem.unmapped_ids)
        return np.asarray(np.maximum(num_free - 1, 0))

    def _associated(self, near: Sequence[int], gate: MapGate | None) -> WeighedAssociations:
        object_ids = np.array([*near, *self._new[0]], dtype=int)
        setting = self._enumeration(object_ids, gate)
        predicted = predict(self.parents.components, self.step.motion, near, self._new)
        if self.identities is None:
            return enumerate_associations(setting, predicted)
        on_map = self.problem.displaced.on_map
        named = np.array(self.identities, dtype=int)[:, None] == [on_map.get(int(n), int(n)) for n in object_ids]
        if self.log_clutter is None and not on_map:
            return fixed_association(setting, predicted, np.nonzero(named)[1])
        admitted = np.broadcast_to(named, (len(self.parents), *named.shape))  # (P, n, O)
        if setting.admitted is not None:
            admitted = admitted & setting.admitted
        found = enumerate_associations(replace(setting, admitted=admitted, distinct=False), predicted)
        assert found.problem is not None and found.start is not None
        return replace(found, mode=find_modes(found.problem, found.start))

    def _best(self, candidates: WeighedAssociations) -> Array:
        """(P,) geometric evidence of the best association of each parent."""
        rows, best = candidates.assignments, np.full(len(self.parents), -np.inf)
        np.maximum.at(best, rows.parents, rows.column("log_evidence"))
        return best

    def _enumeration(self, object_ids: Index, gate: MapGate | None) -> EnumerationProblem:
        known = [[own.classes.get(n, -1) for n in object_ids.tolist()] for own in self.parents.components]
        return EnumerationProblem(
            spaces=self.problem.spaces,
            model=self.problem.model,
            detections=[self.step.detections[i] for i in self.used],
            object_ids=object_ids,
            known_classes=np.array(known, dtype=int).reshape(len(self.parents), len(object_ids)),
            log_class_prior=self._log_class_prior(object_ids),
            distinct=self.problem.distinct,
            gate=self.problem.weights.gate if self.path is None else np.inf,
            max_candidates=candidate_limit(self.problem.weights, len(self.used)),
            path=self._path(object_ids.tolist()),
            admitted=self._admitted(object_ids, gate),
            exclusive=exclusive_objects(self.problem.displaced, object_ids),
            placeholders=Placeholders.of(self.problem.unmapped_ids, object_ids, self.parents.components),
            log_clutter=self.log_clutter,
        )

    def _admitted(self, object_ids: Index, gate: MapGate | None) -> Flags | None:
        """(P, n, O) admitted pairs: within the gate, of objects that the history does not rule out; None: all."""
        near = gate.admitted[:, :, gate.columns()] if gate is not None else None
        if not self.problem.displaced.elsewhere:
            return near
        possible = possible_objects(self.parents.components, object_ids)
        return np.repeat(possible, len(self.used), axis=1) if near is None else near & possible

    def _path(self, object_ids: list[int]) -> tuple[Index, Index] | None:
        """(n,) object columns (-1 clutter) and (n,) classes of the one continuation wanted; None: all are."""
        if self.path is None:
            return None
        wanted = [self.path.association[i] for i in self.used]
        objects = [object_ids.index(n) if n >= 0 else -1 for n in wanted]
        return np.array(objects, dtype=int), np.array([self.path.class_assignment[i] for i in self.used], dtype=int)

    def _log_class_prior(self, object_ids: Index) -> Array:
        """(O, C) log prior class probabilities of the objects."""
        return self.registry.log_class_prior_of(object_ids.tolist())

    def _with_classes(self, candidates: WeighedAssociations) -> WeighedAssociations:
        """Expand the candidates by the classes of the objects that they observe, and find their modes."""
        setting, log_outlier = self._enumeration(candidates.object_ids, None), self._log_outlier
        found = enumerate_classes(setting, candidates, log_outlier)
        assert found.problem is not None and found.start is not None
        mode = find_modes(found.problem, found.start, tolerance=WEIGHING_TOLERANCE)
        found = replace(found, mode=mode)
        if log_outlier is None:
            return found
        prior = found.assignments.column("log_class_prior") + log_first_inliers(setting, found, log_outlier)
        return found.gaining(log_class_prior=prior)

    def _with_evidence(self, candidates: WeighedAssociations) -> WeighedAssociations:
        """Add the evidence, as configured: by importance sampling and mode splitting, Laplace, or prior samples.

        It includes that of the measurement of gravity, which is the same for all candidates of a parent.
        """
        weights, (problem, mode), method = self.problem.weights, candidates.solved(), self._method
        log_level = log_levels(self.parents.components, self.step.motion)
        of_rows = log_level[candidates.assignments.parents]
        if method == "importance":
            unsplit = UnsplitCandidates(
                step=self.step,
                parents=self.parents.components,
                log_parent_weights=self.parents.log_weights,
                candidates=candidates,
                used=self.used,
                new=self._new,
                log_level=log_level,
                is_cut_off=self._is_cut_off,
            )
            return split_modes(unsplit, weights, self.path.component_mode if self.path is not None else None)
        if method == "laplace":
            log_evidence = mode.log_evidence + problem.log_visibility(mode.y, soft=True) + of_rows
            return candidates.gaining(
                log_evidence=log_evidence, effective_sample_sizes=np.full(len(log_evidence), np.nan)
            )
        log_evidence, effective = sample_evidence(problem, weights.num_samples, self._generators(candidates))
        return candidates.gaining(log_evidence=log_evidence + of_rows, effective_sample_sizes=effective)

    @property
    def _method(self) -> str:
        """How evidence is computed: as configured, or by Laplace where a prior is too broad for samples.

        A named object that was seen once has such a prior. Prior samples would never hit the likelihood of its first
        view; importance samples do, but no better than Laplace where candidates compete over it. Without classes, log
        evidence of three keyframes (8 worlds, against 20000 samples) errs by 0.06 nats either way for new objects, by
        0.007 (Laplace) and 0.011 for the map's under wrong names, by 0.008 and 0.019 for what was moved.
        """
        configured = self.problem.weights.method
        is_too_broad = {
            "sampled": any(self._new),
            "importance": self._has_named_rivals and not self._is_cut_off,
        }
        return "laplace" if is_too_broad.get(configured, False) else configured

    @property
    def _is_cut_off(self) -> bool:
        """Whether limits of visibility cut Gaussians off, of mapped objects alone: samples can show that of these."""
        return not self.problem.model.sees_everywhere and (self.identities is None or self._names_the_map_alone)

    @property
    def _has_named_rivals(self) -> bool:
        """Whether candidates compete over given identities: a wrong one, or a first view of a new object as an outlier.

        Or over what was moved, in a keyframe that names an object which the map lacks.
        """
        if self.identities is None:
            return False
        if self.log_clutter is not None or (any(self._new) and self._log_outlier is not None):
            return True
        return bool(self.problem.displaced.elsewhere) and not self._names_the_map_alone

    @property
    def _names_the_map_alone(self) -> bool:
        """Whether all identities are of mapped objects."""
        return self.problem.map_ids.issuperset(self.identities or ())

    @cached_property
    def _log_outlier(self) -> Array | None:
        """(n,) log density of each view as an outlier, its share included; None: no view is one."""
        model = self.problem.model
        seen = model.collect([self.step.detections[i] for i in self.used])
        return model.log_outlier(seen) if isinstance(model, ModelsOutliers) else None

    def _generators(self, candidates: WeighedAssociations) -> list[np.random.Generator]:
        """One random generator for each candidate, seeded by its hypothesis id and thus reproducible."""
        rows, stamp = candidates.assignments, self.step.stamp_ns
        steps = candidates.steps(self.used, len(self.step.names))
        ids = [
            hypothesis_id(self.parents.ids[p], stamp, own.association, own.class_assignment, own.mode)
            for p, own in zip(rows.parents, steps, strict=True)
        ]
        return [generator(self.problem.seed, "weights", stamp, key) for key in ids]
