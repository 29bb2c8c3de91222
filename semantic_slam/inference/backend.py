"""A backend: holds components, weighs their continuations, forks and updates the survivors."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semantic_slam.errors import SemanticSlamError
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.build import problem_of
from semantic_slam.inference.class_marginals import class_marginals
from semantic_slam.inference.component_marginals import ComponentMarginals, aligned_marginals, component_marginals
from semantic_slam.inference.descriptor_marginals import descriptor_marginals
from semantic_slam.inference.expander import Continuations, Expander
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.objects import ObjectRegistry, ReportedObjects
from semantic_slam.inference.open_world.open_expander import OpenExpander
from semantic_slam.inference.problem import Problem
from semantic_slam.inference.protocol import Candidates, Commit, Components, RunConfiguration
from semantic_slam.inference.smoothing.component import Component, LostComponentError, WeightedComponent
from semantic_slam.inference.smoothing.growth import Outcome, certain
from semantic_slam.inference.states.identity import ROOT_ID, hypothesis_id
from semantic_slam.inference.states.lineage import LineageStep


class Backend:
    """Answers keyframes with candidates and commits with components; every answer is a pure function of both.

    ``problem`` replaces the planar problem that a run announces. Call :meth:`start` before anything else.
    """

    def __init__(self, backend_id: int, problem: Problem | None = None):
        self.backend_id = backend_id
        self._given_problem = problem

    def start(self, run: RunConfiguration) -> None:
        """Begin a run: hold the hypothesis before any measurement."""
        self.run_id = run.run_id
        self.problem = self._given_problem or problem_of(run)
        self.registry = ObjectRegistry(self.problem.objects, len(self.problem.class_names))
        self.expander: Expander | OpenExpander = Expander(self.problem, self.registry)
        if self.problem.association == "open":
            self.expander = OpenExpander(self.problem, self.registry)
        self.held: dict[int, WeightedComponent] = {
            ROOT_ID + number: WeightedComponent(self.expander.root(number), log_weight)
            for number, log_weight in enumerate(self.problem.log_root_weights)
        }
        self.steps: list[Step] = []
        self.committed = -1
        self._expanded: tuple[Continuations, list[int]] | None = None
        self._asked: set[int] = set()  # what the newest commit gave to this backend
        self._answer: Components | None = None
        self._roster = ReportedObjects(self.problem.objects, len(self.problem.class_names), ())

    def expand(self, keyframe: Any) -> Candidates:
        """Round one for a keyframe: the next one, or the newest again. Raises SemanticSlamError on a gap."""
        step = self.problem.reader.step(keyframe)
        if step.index == len(self.steps):
            self.steps.append(step)
        elif step.index != len(self.steps) - 1:
            raise SemanticSlamError(
                f"backend {self.backend_id}: keyframe {len(self.steps)} is missing; start the run again"
            )
        self._register(step)
        if not self.held:
            return self._no_candidates(step)
        parents = sorted(self.held)
        continuations = self.expander.expand(step, parents, [self.held[n] for n in parents])
        self._expanded = (continuations, parents)
        return self._candidates(step, continuations, parents)

    def commit(self, commit: Commit) -> Components | None:
        """Round two; None for a commit older than the newest one (stale). A repeated commit changes nothing."""
        mine = {int(n) for n in commit.ids[commit.owners == self.backend_id]}
        if commit.keyframe < self.committed:
            return None
        if self._answer is not None and commit.keyframe == self.committed and mine == self._asked:
            return self._answer
        rows = np.flatnonzero(commit.owners == self.backend_id)
        grown = self._survivors(commit, rows)
        weights = dict(zip(commit.ids[rows].tolist(), commit.log_weights[rows].tolist(), strict=True))
        kept = {number: own for number, own in grown.items() if isinstance(own, Component)}
        self.held = {number: WeightedComponent(own, weights[number]) for number, own in kept.items()}
        self.committed, self._expanded = commit.keyframe, None
        lost = {number: str(own) for number, own in grown.items() if number not in kept}
        self._asked, self._answer = mine, self._report(commit.keyframe, lost)
        return self._answer

    def _survivors(self, commit: Commit, rows: NDArray[np.int_]) -> dict[int, Outcome]:
        """As they are held, grown from what was expanded, or rebuilt."""
        survivors: dict[int, Outcome] = {}
        growing, rebuilt = {}, dict[int, Component]()
        at = self._places_expanded(commit.keyframe)
        for row in rows:
            number, parent = int(commit.ids[row]), int(commit.parent_ids[row])
            if self.committed == commit.keyframe and number in self.held:
                survivors[number] = self.held[number].component
            elif number in at and parent in self.held:
                growing[number] = at[number]
            else:
                lineage = (*commit.lineages[row], commit.steps[row])
                try:
                    survivors[number] = self._rebuild(lineage, commit.keyframe + 1, rebuilt)
                except LostComponentError as fault:
                    survivors[number] = fault
        if growing and self._expanded is not None:
            grown = self._grown(self.steps[commit.keyframe], *self._expanded, list(growing.values()))
            survivors.update(zip(growing, grown, strict=True))
        return survivors

    def _places_expanded(self, keyframe: int) -> dict[int, int]:
        """Where the continuations by this keyframe are among those expanded."""
        if self._expanded is None or self.committed != keyframe - 1:
            return {}
        return {number: at for at, number in enumerate(self._expanded[0].ids)}

    def _grown(self, step: Step, found: Continuations, parent_ids: list[int], at: list[int]) -> list[Outcome]:
        """The components of some continuations, which may use up their parents."""
        parents = [self.held[parent_ids[found.parents[one]]].component for one in at]
        return self.expander.grow(step, found, parents, at, in_place=True)

    def _rebuild(self, lineage: Sequence[LineageStep], length: int, rebuilt: dict[int, Component]) -> Component:
        """A component from its lineage alone; trunks that lineages share are replayed once."""
        if len(lineage) != length:
            raise LostComponentError(f"backend {self.backend_id} was given no lineage")
        number = ROOT_ID + (lineage[0].mode if len(self.problem.noise_factors) > 1 else 0)
        component = self.expander.root(number - ROOT_ID)
        for step, taken in zip(self.steps[:length], lineage, strict=True):
            child = hypothesis_id(number, step.stamp_ns, taken.association, taken.class_assignment, taken.mode)
            if child not in rebuilt:
                continuations = self.expander.expand(step, [number], [WeightedComponent(component, 0.0)], taken)
                if child not in continuations.ids:
                    raise LostComponentError("a lineage names an impossible continuation")
                at = [continuations.ids.index(child)]
                rebuilt[child] = certain(self.expander.grow(step, continuations, [component], at, in_place=False)[0])
            number, component = child, rebuilt[child]
        return component

    def _register(self, step: Step) -> None:
        self.registry.introduce(step.index, len(step.names))
        if self.problem.association == "given":
            for name in step.names:
                self.registry.identify(name)

    def _candidates(self, step: Step, found: Continuations, parents: list[int]) -> Candidates:
        robot, landmark = self.problem.spaces.robot, self.problem.spaces.landmark
        count, detections, size = len(found.ids), len(step.names), landmark.tangent_size
        states = np.full((count, detections, landmark.storage_size), np.nan)
        covariances = np.full((count, detections, size, size), np.nan)
        states[:, found.used], covariances[:, found.used] = found.objects, found.object_covariances
        weights = np.array([self.held[n].log_weight for n in parents])
        return Candidates(
            run_id=self.run_id,
            keyframe=step.index,
            backend_id=self.backend_id,
            ids=np.array(found.ids, dtype=np.uint64),
            parent_ids=np.array(parents, dtype=np.uint64)[found.parents],
            associations=_rows([s.association for s in found.steps], detections),
            class_assignments=_rows([s.class_assignment for s in found.steps], detections),
            modes=np.array([s.mode for s in found.steps], dtype=np.uint16),
            log_weights=weights[found.parents] + found.log_psi,
            effective_sample_sizes=found.effective_sample_sizes,
            poses=robot.poses(found.robot),
            pose_covariances=robot.covariances(found.robot, found.robot_covariance),
            object_poses=landmark.poses(states),
            object_covariances=landmark.covariances(states, covariances),
            expanded_parent_ids=np.array(parents, dtype=np.uint64),
            log_mass_not_enumerated=weights + found.log_left_out,
        )

    def _no_candidates(self, step: Step) -> Candidates:
        detections = len(step.names)
        none, parents = np.zeros(0), np.zeros(0, dtype=np.uint64)
        return Candidates(
            self.run_id,
            step.index,
            self.backend_id,
            parents,
            parents,
            _rows([], detections),
            _rows([], detections),
            np.zeros(0, dtype=np.uint16),
            none,
            none,
            np.zeros((0, 7)),
            np.zeros((0, 6, 6)),
            np.zeros((0, detections, 7)),
            np.zeros((0, detections, 6, 6)),
            parents,
            none,
        )

    def _report(self, keyframe: int, lost: dict[int, str]) -> Components:
        """``lost``: why hypotheses could not be grown, to which those are added whose moments are not to be had."""
        found: dict[int, ComponentMarginals] = {}
        registry = self._present()
        for number in sorted(self.held):
            try:
                found[number] = component_marginals(self.held[number].component, registry)
            except LostComponentError as fault:
                lost[number] = str(fault)
                del self.held[number]
        components = [self.held[number].component for number in found]
        poses, covariances, existence = self._in_map(list(found.values()), len(registry.ids))
        classes = class_marginals(components, registry)
        descriptors = [descriptor_marginals(component, registry) for component in components]
        return Components(
            run_id=self.run_id,
            keyframe=keyframe,
            backend_id=self.backend_id,
            ids=np.array(list(found), dtype=np.uint64),
            poses=poses[:, 0],
            pose_covariances=covariances[:, 0],
            object_ids=np.array(registry.ids, dtype=np.uint32),
            object_poses=poses[:, 1:],
            object_covariances=covariances[:, 1:],
            class_probabilities=classes.probabilities,
            mutual_information=classes.mutual_information,
            in_coverage=classes.in_coverage,
            forgotten_views=classes.forgotten_views,
            existence=existence,
            lost_ids=np.array(list(lost), dtype=np.uint64),
            lost_reasons=tuple(lost.values()),
            descriptors=_stacked([known.mean for known in descriptors], len(registry.ids)),
            descriptor_variances=_stacked([known.variance for known in descriptors], len(registry.ids)),
        )

    def _present(self) -> ObjectRegistry:
        """The objects that are reported: in an open world those that some hypothesis holds."""
        if self.problem.association != "open":
            return self.registry
        alive = frozenset[int]().union(*(held.component.object_ids for held in self.held.values()))
        self._roster = self._roster.with_only(alive)
        return self._roster

    def _in_map(self, found: Sequence[ComponentMarginals], num_objects: int) -> tuple[Array, Array, Array]:
        """(H, 1 + O, 7) poses, (H, 1 + O, 6, 6) covariances and (H, O) existence, NaN for what is absent."""
        states, spread, existence = aligned_marginals(found, num_objects, self.problem.spaces.storage.width)
        poses, covariances = self.problem.spaces.in_map(states, spread)
        absent = np.isnan(states).any(axis=-1)
        poses[absent], covariances[absent] = np.nan, np.nan
        return poses, covariances, existence


def _stacked(rows: list[Array], num_objects: int) -> Array:
    """(S, O, L) from (O, L); L is 0 without rows."""
    return np.array(rows) if rows else np.zeros((0, num_objects, 0))


def _rows(rows: list[tuple[int, ...]], width: int) -> NDArray[np.int32]:
    return np.array(rows, dtype=np.int32).reshape(len(rows), width)
