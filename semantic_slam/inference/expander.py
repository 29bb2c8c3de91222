"""All continuations of a set of parents by one keyframe, weighed: rounds one's work of a backend."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import block_diag

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.association.enumeration import (
    EnumeratedAssignments,
    EnumerationProblem,
    enumerate_associations,
    enumerate_classes,
    fixed_association,
)
from semantic_slam.inference.association.map_gate import FEW_OBJECTS, MapGate, map_gate
from semantic_slam.inference.evidence.allocation import keep_freed_memory
from semantic_slam.inference.evidence.importance import normal_points
from semantic_slam.inference.evidence.keyframe_problem import Assignments, KeyframeProblem, PredictedBelief
from semantic_slam.inference.evidence.laplace import WEIGHING_TOLERANCE, Mode, find_modes
from semantic_slam.inference.evidence.mode_splitting import ModeSplit, WeighedAssignments, split_modes
from semantic_slam.inference.evidence.posterior_mode import PosteriorMode
from semantic_slam.inference.evidence.prior_samples import sample_evidence
from semantic_slam.inference.evidence.window import Window
from semantic_slam.inference.models.step import AssociatedDetection, Motion, Step
from semantic_slam.inference.objects import ObjectRegistry
from semantic_slam.inference.problem import Problem
from semantic_slam.inference.semantics.interface import Records, SemanticEvidence, SemanticInput
from semantic_slam.inference.smoothing.component import Component, ComponentUpdate, WeightedComponent
from semantic_slam.inference.smoothing.growth import Outcome, grow_all
from semantic_slam.inference.states.correction import Correction
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.states.identity import generator, hypothesis_id
from semantic_slam.inference.states.keys import object_key, robot_key
from semantic_slam.inference.states.lineage import LineageStep
from semantic_slam.inference.states.object_views import ObjectViews


@dataclass(frozen=True)
class Continuations:
    """K continuations of P parents; n used detections."""

    ids: list[int]  # K
    parents: Index  # (K,) index of the parent
    steps: list[LineageStep]  # K
    log_psi: Array  # (K,) Eq. 4.18 without the parent's weight
    effective_sample_sizes: Array  # (K,)
    robot: Array  # (K, s) mode
    robot_covariance: Array  # (K, r, r)
    objects: Array  # (K, n, s) modes of the objects of the used detections
    object_covariances: Array  # (K, n, l, l)
    used: Index  # (n,) detections that take part; the others are clutter in every continuation
    log_left_out: Array  # (P,) estimate of the mass not weighed, relative to the parent's weight
    new_objects: list[dict[int, GaussianPrior]]  # P: objects that this keyframe introduces
    records: Records  # of the objects seen, for those that grow
    robot_corrections: list[Correction | None]  # K
    refined: list[PosteriorMode | None]  # K: what the whole history had to say, where it was looked at
    histories: list[Window | None]  # K: since the continuation was last Gaussian

    def continued(self, at: int, views: dict[int, ObjectViews]) -> ComponentUpdate:
        """What a component needs to know of one continuation, with records of its ``views``."""
        refined = self.refined[at]
        association = self.steps[at].association
        return ComponentUpdate(
            self.robot[at],
            [state for i, state in zip(self.used, self.objects[at], strict=True) if association[i] >= 0],
            self.new_objects[self.parents[at]],
            views,
            self.robot_corrections[at],
            self.histories[at],
            refined.smoothed if refined is not None else {},
            refined.corrections if refined is not None else {},
        )


class Expander:
    """Weighs continuations; a pure function of the problem, the registry and what it is given."""

    def __init__(self, problem: Problem, registry: ObjectRegistry):
        self.problem, self.registry = problem, registry
        if problem.association != "open" and problem.weights.method == "importance":
            normal_points(1, 1)  # what it imports takes longer than a keyframe may
            keep_freed_memory()

    def root(self, number: int) -> Component:
        """The component before any keyframe."""
        return self.problem.root()

    def grow(
        self, step: Step, found: Continuations, parents: Sequence[Component], at: Sequence[int], *, in_place: bool
    ) -> list[Outcome]:
        """The components of the continuations ``at``, each from its own of ``parents``.

        ``in_place``: nobody needs the parents again, and a child may use its own up.
        """
        observed = [_observed(step, found, one) for one in at]
        continued = [found.continued(*parts) for parts in zip(at, found.records(at), strict=True)]
        return grow_all(parents, step.motion, observed, continued, in_place=in_place)

    def expand(
        self, step: Step, parent_ids: Sequence[int], held: Sequence[WeightedComponent], path: LineageStep | None = None
    ) -> Continuations:
        """Continuations of every parent, or of one along ``path`` alone. Raises LostComponentError."""
        components = [each.component for each in held]
        given = [self.registry.identify(name) for name in step.names] if self.problem.association == "given" else None
        used = self._used(step, given)
        known, unknown = self._objects(components[0], used, given)
        new = [self._new_objects(component, step, used, given, unknown) for component in components]
        if path is not None and len(known) > FEW_OBJECTS:
            known = [n for n in known if n in path.association]
        reach = self._reach(step, components, used, known) if given is None and path is None else None
        while True:
            near = known if reach is None else [known[i] for i in reach.columns()]
            object_ids = [*near, *unknown]
            setting = self._setting(step, used, object_ids, components, path, reach)
            predicted = predict(components, step.motion, near, new)
            enumerated, mode = self._enumerate(setting, predicted, used, given, object_ids)
            wider = reach.widened(enumerated.log_best, setting.gate) if reach is not None else None
            if wider is None:
                break
            reach = wider
        if reach is not None:
            outside = reach.log_left_out(enumerated.log_best)
            enumerated = replace(enumerated, log_left_out=np.logaddexp(enumerated.log_left_out, outside))
        stack = enumerated.stack
        if setting.model.num_classes > 0 and len(used):
            mode = find_modes(stack, enumerated.start, tolerance=WEIGHING_TOLERANCE)
        steps = _lineage_steps(stack.rows, used, object_ids, len(step.names))
        expanded = WeighedAssignments(
            step=step,
            parents=components,
            log_parent_weights=np.array([each.log_weight for each in held]),
            stack=stack,
            mode=mode,
            log_prior=enumerated.log_class_prior,
            lineage_steps=steps,
            used=used,
            new=new,
            object_ids=object_ids,
        )
        splits = self._split(expanded, parent_ids, steps, path)
        prior = self.registry.log_class_prior()[[self.registry.index(n) for n in object_ids]]
        stack, mode = _at_modes(expanded, splits)
        moment = SemanticInput(step, components, stack, mode, used, object_ids, prior, new)
        return self._weighed(moment, parent_ids, enumerated, steps, splits)

    def _used(self, step: Step, given: list[int] | None) -> Index:
        """Detections that can be an object: with an identity, or the best-scored where there are more than objects."""
        if given is not None:
            return np.array([i for i, number in enumerate(given) if number >= 0], dtype=int)
        limit = len(self.registry.ids) if self.problem.distinct else (len(step.names) if self.registry.ids else 0)
        order = np.argsort(-step.scores, kind="stable")
        return np.asarray(np.sort(order[:limit]))

    def _objects(self, component: Component, used: Index, given: list[int] | None) -> tuple[list[int], list[int]]:
        """Ids that this keyframe may concern: those on the map, and those that it introduces to every hypothesis."""
        object_ids = list(self.registry.ids) if given is None else sorted({given[i] for i in used})
        known = [n for n in object_ids if n in component.object_ids]
        return known, [n for n in object_ids if n not in component.object_ids]

    def _new_objects(
        self, component: Component, step: Step, used: Index, given: list[int] | None, unknown: list[int]
    ) -> dict[int, GaussianPrior]:
        """Broad priors about where this hypothesis first sees the unknown objects."""
        if given is None or not unknown:
            return {}
        robot = self.problem.spaces.robot.compose(component.newest_robot(), step.motion.control)
        first = {n: next(step.detections[i] for i in used if given[i] == n) for n in unknown}
        return {n: self.problem.model.object_prior(detection, robot) for n, detection in first.items()}

    def _reach(self, step: Step, components: Sequence[Component], used: Index, known: list[int]) -> MapGate | None:
        """What of a large map is looked at; None: all of it."""
        gate = self.problem.weights.gate
        if len(known) <= FEW_OBJECTS or not len(used) or not np.isfinite(gate):
            return None
        prior = {entry.object_id: entry.prior.covariance for entry in self.problem.objects}
        objects = [(number, prior[number]) for number in known]
        detections = [step.detections[i] for i in used]
        return map_gate(self.problem.spaces, self.problem.model, step, detections, components, objects, gate)

    def _setting(
        self,
        step: Step,
        used: Index,
        object_ids: list[int],
        components: Sequence[Component],
        path: LineageStep | None,
        reach: MapGate | None,
    ) -> EnumerationProblem:
        known = [[component.classes.get(n, -1) for n in object_ids] for component in components]
        selected = [self.registry.index(n) for n in object_ids]
        exact = path is not None
        return EnumerationProblem(
            self.problem.spaces,
            self.problem.model,
            [step.detections[i] for i in used],
            np.array(known, dtype=int).reshape(len(components), len(object_ids)),
            self.registry.log_class_prior()[selected],
            self.problem.distinct,
            np.inf if exact else self.problem.weights.gate,
            self.problem.weights.max_candidates,
            _path(path, used, object_ids) if path is not None else None,
            reach.admitted[:, :, reach.columns()] if reach is not None else None,
        )

    def _enumerate(
        self,
        setting: EnumerationProblem,
        predicted: PredictedBelief,
        used: Index,
        given: list[int] | None,
        object_ids: list[int],
    ) -> tuple[EnumeratedAssignments, Mode]:
        if given is None:
            enumerated, mode = enumerate_associations(setting, predicted)
        else:
            index = np.array([object_ids.index(given[i]) for i in used], dtype=int)
            enumerated, mode = fixed_association(setting, predicted, index)
        if setting.model.num_classes > 0 and len(used):
            enumerated = enumerate_classes(setting, enumerated)
        return enumerated, mode

    def _split(
        self,
        expanded: WeighedAssignments,
        parent_ids: Sequence[int],
        steps: Sequence[LineageStep],
        path: LineageStep | None,
    ) -> ModeSplit:
        weights, rows = self.problem.weights, expanded.stack.rows
        if weights.method == "importance":
            return split_modes(expanded, weights, path.mode if path is not None else None)
        if weights.method == "laplace":
            log_evidence = expanded.mode.log_evidence + expanded.stack.log_visibility(expanded.mode.y, soft=True)
            return ModeSplit.unchanged(log_evidence, np.full(len(steps), np.nan))
        stamp = expanded.step.stamp_ns
        ids = [_identity(parent_ids[p], stamp, each) for p, each in zip(rows.parents, steps, strict=True)]
        generators = [generator(self.problem.seed, "weights", stamp, key) for key in ids]
        return ModeSplit.unchanged(*sample_evidence(expanded.stack, weights.num_samples, generators))

    def _weighed(
        self,
        moment: SemanticInput,
        parent_ids: Sequence[int],
        enumerated: EnumeratedAssignments,
        steps: Sequence[LineageStep],
        splits: ModeSplit,
    ) -> Continuations:
        rows, step, stack, mode, used = moment.stack.rows, moment.step, moment.stack, moment.mode, moment.used
        origins = zip(splits.origin.tolist(), splits.number.tolist(), strict=True)
        of_modes = [replace(steps[row], mode=number) if number else steps[row] for row, number in origins]
        ids = [_identity(parent_ids[p], step.stamp_ns, s) for p, s in zip(rows.parents, of_modes, strict=True)]
        states, covariances = stack.marginals(mode.y, mode.hessian)
        robot, own = slice(stack.layout.robot), slice(stack.layout.landmark)
        weighed = self._semantics(moment)
        log_psi = splits.log_evidence + enumerated.log_class_prior[splits.origin] + weighed.log_weights
        best = np.full(len(parent_ids), -np.inf)
        np.maximum.at(best, rows.parents, log_psi)
        return Continuations(
            ids=ids,
            parents=rows.parents,
            steps=of_modes,
            log_psi=log_psi,
            effective_sample_sizes=np.fmin(splits.effective_sample_sizes, weighed.effective_sample_sizes),
            robot=stack.robots_of(states),
            robot_covariance=covariances[:, 0, robot, robot],
            objects=_of_detections(stack, states)[..., : stack.spaces.storage.landmark],
            object_covariances=_of_detections(stack, covariances)[..., own, own],
            used=used,
            log_left_out=enumerated.log_left_out + best,
            new_objects=list(moment.new),
            records=weighed.records,
            robot_corrections=weighed.robot,
            refined=splits.refined,
            histories=splits.histories,
        )

    def _semantics(self, moment: SemanticInput) -> SemanticEvidence:
        count = len(moment.stack.mean)
        if self.problem.semantics is None or not len(moment.used):
            return SemanticEvidence.silent(count)
        return self.problem.semantics.weigh(moment)


def predict(
    components: Sequence[Component], motion: Motion, known: Sequence[int], new: Sequence[dict[int, GaussianPrior]]
) -> PredictedBelief:
    """b^-[x_k, O] (Eqs. 4.11, 4.21) of every parent of one keyframe, the new objects after the known ones."""
    spaces = components[0].spaces
    keys = [robot_key(components[0].keyframe), *(object_key(n) for n in known)]
    mean = np.array([component.states(keys) for component in components])
    covariance = np.array([component.joint_covariance(keys) for component in components])
    own, robot, transition = spaces.storage.block(0), spaces.layout.block(0), spaces.robot.propagation(motion.control)
    mean[:, 0, own] = spaces.robot.compose(mean[:, 0, own], motion.control)
    covariance[:, robot] = transition @ covariance[:, robot]
    covariance[:, :, robot] = covariance[:, :, robot] @ transition.T
    covariance[:, robot, robot] += motion.covariance
    if not any(new):
        return PredictedBelief(spaces.layout, mean, covariance)
    added = [list(priors.values()) for priors in new]
    mean = spaces.storage.stacked(mean, np.array([[prior.mean for prior in priors] for priors in added]))
    pairs = zip(covariance, added, strict=True)
    spread = np.array([block_diag(own, *(p.covariance for p in priors)) for own, priors in pairs])
    return PredictedBelief(spaces.layout, mean, spread)


def _observed(step: Step, found: Continuations, at: int) -> tuple[AssociatedDetection, ...]:
    taken = found.steps[at]
    return step.observed(taken.association, taken.class_assignment, found.used)


def _path(path: LineageStep, used: Index, object_ids: list[int]) -> tuple[Index, Index]:
    objects = [object_ids.index(path.association[i]) for i in used]
    return np.array(objects, dtype=int), np.array([path.class_assignment[i] for i in used], dtype=int)


def _at_modes(expanded: WeighedAssignments, splits: ModeSplit) -> tuple[KeyframeProblem, Mode]:
    """The candidates once for every mode of theirs, where it is."""
    stack = expanded.stack.select(splits.origin)
    mode = expanded.mode
    y, hessian, log_evidence = mode.y[splits.origin], mode.hessian[splits.origin], mode.log_evidence[splits.origin]
    moved = np.array([row for row, refined in enumerate(splits.refined) if refined is not None], dtype=int)
    if len(moved):
        part = stack.select(moved)
        states = [
            expanded.states_of(splits.origin[row], refined) for row, refined in enumerate(splits.refined) if refined
        ]
        y[moved] = part.coordinates(np.array(states))
        hessian[moved] = part.normal_equations(y[moved])[2]
    return stack, Mode(y, hessian, log_evidence)


def _identity(parent_id: int, stamp_ns: int, step: LineageStep) -> int:
    return hypothesis_id(parent_id, stamp_ns, step.association, step.class_assignment, step.mode)


def _lineage_steps(rows: Assignments, used: Index, object_ids: Sequence[int], count: int) -> list[LineageStep]:
    association = np.full((len(rows.objects), count), -1)
    association[:, used] = np.array([*object_ids, -1], dtype=int)[rows.objects]
    assignment = np.full((len(rows.objects), count), -1)
    if rows.classes is not None:
        assignment[:, used] = rows.classes
    return [LineageStep(tuple(a), tuple(c)) for a, c in zip(association.tolist(), assignment.tolist(), strict=True)]


def _of_detections(stack: KeyframeProblem, values: Array) -> Array:
    """(K, 1 + n, ...) values of the blocks to (K, n, ...) of the objects that the detections are associated with."""
    return np.asarray(values[np.arange(len(values))[:, None], 1 + stack.slots])
