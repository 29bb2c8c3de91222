"""A backend: holds the smoothers of some hypotheses, weighs their continuations, forks and updates the survivors."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from semantic_slam.errors import SemanticSlamError
from semantic_slam.inference.association.enumeration import NoAssociationError
from semantic_slam.inference.association.strategy import AssociationStrategy
from semantic_slam.inference.backend_answers import Answers
from semantic_slam.inference.building import problem_of
from semantic_slam.inference.checkpoints.stored_trunks import trunks_of
from semantic_slam.inference.expander import Expander, Expansion
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.kept_steps import KeptSteps
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.protocol import Candidates, Commit, Components, RunConfiguration
from semantic_slam.inference.reported.component_marginals import ComponentMarginals, component_marginals
from semantic_slam.inference.smoothing.component import Component, WeightedComponent
from semantic_slam.inference.smoothing.errors import LostComponentError
from semantic_slam.inference.smoothing.growth import Outcome, certain
from semantic_slam.inference.smoothing.trunks import Trunks
from semantic_slam.inference.states.identity import ROOT_ID
from semantic_slam.inference.states.lineage import LineageStep, as_followed, next_id
from semantic_slam.inference.world.objects import ObjectRegistry, ReportedObjects
from semantic_slam.inference.world.problem import Problem


class Backend:
    """Answers a keyframe with candidates (round one) and a commit with updated components (round two).

    Every answer is a pure function of the keyframes and commits received. Call :meth:`start` before anything else.
    """

    def __init__(self, backend_id: int, problem: Problem | None = None, *, stores_checkpoints: bool = False):
        """``problem`` replaces the problem built from the configuration that a run announces.

        ``stores_checkpoints``: checkpoints are files, too, from which a backend that is started again goes on.
        """
        self.backend_id = backend_id
        self._given_problem, self._stores_checkpoints = problem, stores_checkpoints
        self.trunks = Trunks()
        self.num_rebuilt = self.num_replayed = 0  # components rebuilt so far, and keyframes replayed for them

    def start(self, run: RunConfiguration) -> None:
        """Begin a run: set up its problem and hold the root hypotheses, those before any measurement."""
        self.problem = self._given_problem or problem_of(run)
        self.answers = Answers(run.run_id, self.backend_id, self.problem)
        self.registry = ObjectRegistry(self.problem.objects, self.problem.class_shares, self.problem.displaced)
        self.association: AssociationStrategy = self.problem.association(self.problem, self.registry)
        self.expander = Expander(self.problem, self.association)
        horizon = self.problem.history.horizon_keyframes
        self.steps = KeptSteps(in_memory=horizon or None)
        self.trunks.close()
        self.trunks = trunks_of(
            self.problem.history, run.run_id, lambda: self.association.root(0), stores=self._stores_checkpoints
        )
        self._stand_before(0)

    def share(self, trunks: Trunks) -> None:
        """Rebuild components from ``trunks``, checkpoints that all backends of this process share."""
        self.trunks = trunks

    def _stand_before(self, index: int) -> None:
        """Reset to the state before keyframe ``index``, without history: the root hypotheses if it is 0, else none."""
        self.held: dict[int, WeightedComponent] = {}
        if index == 0:
            self.held = {
                ROOT_ID + root_number: WeightedComponent(self.association.root(root_number), log_weight)
                for root_number, log_weight in enumerate(self.problem.log_root_weights)
            }
        self.committed = index - 1
        self._expanded: Expansion | None = None
        self._offered: Candidates | None = None  # the newest answer to round one, as long as it is valid
        self._asked: set[int] = set()  # survivors that the newest commit assigned to this backend
        self._answer: Components | None = None  # the answer to the newest commit
        self._given: Mapping[int, Component] = {}  # components by hypothesis that the next commit need not rebuild

    def learn(self, keyframe: Keyframe) -> Step:
        """Record a keyframe, the next one or a repeated one, so that lineages through it can be replayed.

        Raises SemanticSlamError if a keyframe is missing before it.
        """
        step = self.problem.reader.step(keyframe)
        if step.index > len(self.steps):
            raise SemanticSlamError(
                f"backend {self.backend_id}: keyframe {len(self.steps)} is missing; start the run again"
            )
        if step.index == len(self.steps):
            self.steps.append(step)
            self.trunks.learn(step)
            self.association.introduce(self.registry, step)
        return step

    def expand(self, keyframe: Keyframe) -> Candidates:
        """Round one: the candidates of the next keyframe, or of one asked for again. Raises SemanticSlamError on a gap.

        A backend that did not commit the previous keyframe holds no component that it could continue, and answers with
        no candidates.
        """
        step = self.learn(keyframe)
        if step.index != self.committed + 1:
            self._stand_before(step.index)
        if self._offered is None or self._offered.keyframe != step.index:
            self._offered = self._offer(step)
        return self._offered

    def _offer(self, step: Step) -> Candidates:
        """Expand all components that are held and return their candidates."""
        if not self.held:
            return self.answers.no_candidates(step)
        parents = sorted(self.held)
        try:
            expansion = self.expander.expand(step, parents, [self.held[n] for n in parents])
        except NoAssociationError:
            return self.answers.no_candidates(step, parents)
        self._expanded = expansion
        return self.answers.candidates(step, expansion, parents)

    def commit(self, commit: Commit) -> Components | None:
        """Round two: make the survivors assigned to this backend; None for a stale commit, older than the newest one.

        Repeating the newest commit changes at most the weights. Survivors that can neither be grown nor rebuilt,
        because no lineage was sent, are left out of the answer; the manager then sends their lineages.
        """
        mine = {int(n) for n in commit.ids[commit.owners == self.backend_id]}
        if commit.keyframe < self.committed:
            return None
        rows = np.flatnonzero(commit.owners == self.backend_id)
        weights = dict(zip(commit.ids[rows].tolist(), commit.log_weights[rows].tolist(), strict=True))
        if self._answer is not None and commit.keyframe == self.committed and mine == self._asked:
            self.held = {number: replace(own, log_weight=weights[number]) for number, own in self.held.items()}
            self._given = {}
            return self._answer
        grown = self._survivors(commit, rows)
        kept = {number: outcome for number, outcome in grown.items() if isinstance(outcome, Component)}
        self.held = {number: WeightedComponent(outcome, weights[number]) for number, outcome in kept.items()}
        self.committed, self._expanded, self._offered, self._given = commit.keyframe, None, None, {}
        self._keep_trunk()
        lost = {number: str(outcome) for number, outcome in grown.items() if number not in kept}
        self._asked, self._answer = set(grown), self._report(commit.keyframe, lost)
        return self._answer

    def offer(self, components: Mapping[int, Component]) -> None:
        """Hand over components by hypothesis, bit-identical to what the next commit would otherwise have to rebuild."""
        self._given = components

    def _survivors(self, commit: Commit, rows: NDArray[np.int_]) -> dict[int, Outcome]:
        """Components of the survivors: already held, grown from the expansion, offered, or rebuilt from lineages."""
        survivors: dict[int, Outcome] = {}
        growing = {}
        at = self._places_expanded(commit.keyframe)
        for row in rows:
            number, parent = int(commit.ids[row]), int(commit.parent_ids[row])
            if self.committed == commit.keyframe and number in self.held:
                survivors[number] = self.held[number].component
            elif number in at and parent in self.held:
                growing[number] = at[number]
            elif number in self._given:
                survivors[number] = self._given[number].fork()
            elif commit.lineages[row] or commit.keyframe == 0:
                lineage = (*commit.lineages[row], commit.steps[row])
                try:
                    survivors[number] = self._rebuild(lineage, commit.keyframe + 1)
                except LostComponentError as fault:
                    survivors[number] = fault
        if growing and self._expanded is not None:
            grown = self.expander.grow(self._expanded, list(growing.values()), in_place=True)
            survivors.update(zip(growing, grown, strict=True))
        return survivors

    def _places_expanded(self, keyframe: int) -> dict[int, int]:
        """Hypothesis id -> row in the expansion of this keyframe; {} if that is not the newest one."""
        if self._expanded is None or self.committed != keyframe - 1:
            return {}
        return {number: at for at, number in enumerate(self._expanded.ids)}

    def _rebuild(self, lineage: Sequence[LineageStep], length: int) -> Component:
        """Rebuild a component by replaying its lineage, from the root or from the latest checkpoint along it.

        Raises LostComponentError where the lineage is missing or impossible.
        """
        if len(lineage) != length:
            raise LostComponentError(f"backend {self.backend_id} was given no lineage")
        lineage, root_number = as_followed(lineage), self.problem.root_number(lineage)
        numbers = [ROOT_ID + root_number]
        for stamp_ns, taken in zip(self.steps.stamps_ns[:length], lineage, strict=True):
            numbers.append(next_id(numbers[-1], stamp_ns, taken))
        begin, component = self.trunks.deepest(numbers) or (0, self.association.root(root_number))
        self.num_rebuilt, self.num_replayed = self.num_rebuilt + 1, self.num_replayed + length - begin
        for at in range(begin, length):
            step, child = self.steps[at], numbers[at + 1]
            expansion = self.expander.expand(
                step, numbers[at : at + 1], [WeightedComponent(component, 0.0)], lineage[at]
            )
            if child not in expansion.ids:
                raise LostComponentError("a lineage names an impossible continuation")
            rows = [expansion.ids.index(child)]
            nobodys = at > begin and not self.trunks.is_due(at)
            component = certain(self.expander.grow(expansion, rows, in_place=nobodys)[0])
            if self.trunks.is_due(at + 1):
                self.trunks.keep(child, component)
        if self.trunks.is_due(length):
            return component.fork()
        return component

    def _keep_trunk(self) -> None:
        """Checkpoint the heaviest component when one is due, for later replays (revision, rebuilding elsewhere)."""
        revision, count = self.problem.revision, self.committed + 1
        is_revised = revision.is_on and count <= revision.horizon
        if not (is_revised or self.problem.history.is_on):
            self.trunks.forget()
        elif self.trunks.is_due(count) and self.held:
            heaviest = max(sorted(self.held), key=lambda number: self.held[number].log_weight)
            self.trunks.keep(heaviest, self.held[heaviest].component.fork())

    def _report(self, keyframe: int, lost: dict[int, str]) -> Components:
        """The answer to a commit: marginals of all components that are held.

        ``lost`` maps hypotheses that could not be grown to the reason; those whose marginals cannot be computed are
        added to it, and are no longer held.
        """
        marginals: list[ComponentMarginals] = []
        reported = self._present()
        for number in sorted(self.held):
            try:
                marginals.append(component_marginals(self.held[number].component, reported))
            except LostComponentError as fault:
                lost[number] = str(fault)
                del self.held[number]
        held = {number: self.held[number].component for number in sorted(self.held)}
        return self.answers.components(keyframe, held, marginals, reported, lost)

    def _present(self) -> ReportedObjects:
        """The objects that are reported, given the components that are held."""
        alive = frozenset[int]().union(*(held.component.every_id for held in self.held.values()))
        return self.association.reported(self.registry, alive)
