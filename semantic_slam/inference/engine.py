"""Algorithm 4.1: the hybrid belief over poses, classes and data association, one keyframe after the other.

The printed algorithm normalises inside the loop over components, which loses each parent's weight and evidence; here
w psi is collected over all parents and normalised once.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from semantic_slam.configuration import Configuration
from semantic_slam.errors import InputError
from semantic_slam.inference.alternatives.alternatives import Alternatives, NoAlternatives
from semantic_slam.inference.association.strategy import AssociationStrategy
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.building import make_run_configuration, problem_of, reference_of, start_of_run
from semantic_slam.inference.candidate_table import CandidateTable
from semantic_slam.inference.evidence.explanation import Explanation, mean_of_known
from semantic_slam.inference.hypotheses import Hypotheses, Hypothesis
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.marginals import Mixture, PassedOver, state_belief
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.object_table import ObjectTable, stack_rows
from semantic_slam.inference.open_world.copies import Copies, Distinct
from semantic_slam.inference.open_world.genuine_objects import GenuineObjects
from semantic_slam.inference.open_world.time_budget import TimeBudget
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.protocol import BackendPool, Components, RunConfiguration
from semantic_slam.inference.pruning import Kinds, Pruned, affordable, prune, widened
from semantic_slam.inference.relocation.recovery import SOON, Recovery
from semantic_slam.inference.relocation.relocation import Relocation
from semantic_slam.inference.relocation.unplaced import in_map
from semantic_slam.inference.revision.looking_back import Present
from semantic_slam.inference.revision.replay import Lineage, Replay
from semantic_slam.inference.revision.revision import Revision, normalised, with_revised
from semantic_slam.inference.rounds import HeldComponent, Rounds, held_components
from semantic_slam.inference.summarised_copies import SummarisedCopies
from semantic_slam.inference.world.carried import carried_to, new_grounds
from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam.inference.world.objects import ObjectRegistry, ReportedObjects
from semantic_slam.inference.world.problem import Problem


class Engine:
    """Drives backends through the two rounds of each keyframe."""

    def __init__(
        self,
        configuration: Configuration,
        map_prior: MapPrior | None = None,
        *,
        initial_pose: ArrayLike | None = None,
        initial_covariance: ArrayLike | None = None,
        backends: int = 1,
    ) -> None:
        """A run in this process, from the robot's pose before the first keyframe: (3,) x, y, yaw or a (7,) pose vector.

        The covariance is (3, 3) or (6, 6), along the axes of map; what is not given is the configuration's
        ``initial_pose``. Raises InputError.
        """
        pose, covariance = start_of_run(configuration, initial_pose, initial_covariance)
        run = make_run_configuration(configuration, map_prior, pose, covariance, stamp_ns=0)
        self._start(run, InProcessPool(backends), None)

    @classmethod
    def of_run(cls, run: RunConfiguration, pool: BackendPool, problem: Problem | None = None) -> Self:
        """With the backends of ``pool``; ``problem`` replaces the problem that the run announces.

        Where detections of such a problem may lie nobody has said: ``unexplained`` is then NaN.
        """
        engine = cls.__new__(cls)
        engine._start(run, pool, problem)
        return engine

    def _start(self, run: RunConfiguration, pool: BackendPool, problem: Problem | None) -> None:
        self.run, self.problem, self.pool = run, problem or problem_of(run), pool
        self.reference = reference_of(run, self.problem) if problem is None else None
        pool.start(run)
        self.association: type[AssociationStrategy] = self.problem.association
        self.registry = ObjectRegistry(self.problem.objects, self.problem.class_shares, self.problem.displaced)
        self.hypotheses = Hypotheses(self.problem.log_root_weights, pool.backend_ids[0], self.problem.bagging)
        self.rounds = Rounds(pool, run.run_id, self.hypotheses)
        merges = self.association.merges_copies
        self.copies = Copies(self.problem) if merges else self._copies_of_known_objects()
        self.alternatives = Alternatives(list(self.hypotheses.live)) if merges else NoAlternatives()
        self.budget = TimeBudget(self.problem.open_world.time_budget_ms, self.problem.pruning)
        self.genuine = GenuineObjects(
            self.problem.open_world, self.problem.detection_errors, counts_misses=self.association.counts_misses
        )
        association = self.association(self.problem, self.registry)
        self.steps: list[Step] = []  # so far, where histories are replayed
        dissolves = self.problem.spaces.name == "spatial" or self.problem.revision.second_boxes_every_keyframes > 0
        anew = self.registry if dissolves else None
        replay = Replay(self.problem, association, self.steps, anew)
        self.revision = Revision(self.problem.revision, replay, self.registry)
        self.relocation = Relocation(
            self.problem.revision, Replay(self.problem, association, self.steps), self.registry
        )
        self.recovery = Recovery(Replay(self.problem, association, self.steps), self.registry)
        self.explanation = Explanation()
        self.log_evidence = 0.0  # log P(Z_1:k) under the hypotheses kept

    def _copies_of_known_objects(self) -> Distinct | SummarisedCopies:
        return SummarisedCopies(self.problem) if self.problem.history.is_on else Distinct()

    @property
    def live(self) -> dict[int, Hypothesis]:
        """Hypothesis id -> hypothesis, heaviest first."""
        return self.hypotheses.live

    @property
    def carried(self) -> float:
        """Probability that the robot was carried elsewhere in the last keyframes, or once and has not been found."""
        if not self.recovery.is_on:
            return 0.0
        lately = slice(max(self.hypotheses.num_keyframes - SOON, 1), None)
        weights = [
            own.log_weight
            for own in self.live.values()
            if any(map(carried_to, own.lineage[lately])) or new_grounds(own.lineage)
        ]
        return float(np.exp(np.logaddexp.reduce(weights))) if weights else 0.0

    @property
    def lost(self) -> Counter[str]:
        """Hypotheses that backends had to give up, by reason."""
        return self.rounds.lost

    def process(self, keyframe: Keyframe) -> HybridBelief:
        """Algorithm 4.1 for one keyframe; raises SemanticSlamError when no hypothesis survives it."""
        self.budget.begin()
        step = self.introduce(keyframe)
        weighed = self.propagate_weights(keyframe, step)  # for every component with w > 0
        candidates = self.copies.merged(weighed)
        kept = self.prune_and_normalise(candidates)
        components, reported = self.add_observation_factors(step, candidates, kept)  # those with w > 0 alone
        self.alternatives.follow(weighed, self.live, components)
        components, reported = self.revise(step, components, reported)
        self.budget.end(len(self.hypotheses))
        belief = self.weighted_components(step, components, reported, candidates, kept)
        return self.judged(step, belief, candidates, kept)

    def introduce(self, keyframe: Keyframe) -> Step:
        """Actions and measurements u_k-1, Z_k in the order of detections; objects that they may start get ids.

        Raises InputError.
        """
        step = self.problem.reader.step(keyframe)
        if step.index != self.hypotheses.num_keyframes:
            raise InputError(
                f"keyframe {step.index} came in place of {self.hypotheses.num_keyframes}; number them without a gap"
            )
        self.association.introduce(self.registry, step)
        return step

    def propagate_weights(self, keyframe: Keyframe, step: Step) -> CandidateTable:
        """PropWeights: w psi of every assignment beta_k of every component, moved by the motion model: Eqs. 4.18-4.21.

        Components are moved and weighed where they are held, see ``Expander.expand``.
        """
        return self.rounds.expand(keyframe, step.index)

    def prune_and_normalise(self, candidates: CandidateTable) -> Pruned:
        """PruneAndNormalize, over all parents at once, less while data are not explained; what goes is counted."""
        limits = affordable(self.budget.limits(), self.hypotheses.num_keyframes + 1)
        limits = widened(limits, self.explanation.unexplained)
        kinds = Kinds(positions=candidates.poses[:, :3], beginnings=self.hypotheses.beginnings(candidates))
        kept = prune(candidates.log_weights, candidates.ids, candidates.log_missing, limits, kinds)
        self.log_evidence += kept.log_mass
        return kept

    def add_observation_factors(
        self, step: Step, candidates: CandidateTable, kept: Pruned
    ) -> tuple[dict[int, HeldComponent], ReportedObjects]:
        """The components of what was kept, with the factors of Z_k: Eqs. 4.9 and 4.10; and the objects they are over.

        A component whose system turns out to be indeterminate goes, with its hypothesis.
        """
        children = self.hypotheses.children(candidates, kept, self.pool.backend_ids)
        children, answers = self.rounds.commit(step.index, children)
        reported = self._reported(answers)
        components = held_components(answers, reported)
        self.hypotheses.accept(children, components, kept.discarded)
        self.hypotheses.discarded.find(candidates.log_found)
        self.copies.remember(self.live, {n: components[n].objects for n in self.live}, reported, self.registry)
        return components, reported

    def revise(
        self, step: Step, components: dict[int, HeldComponent], reported: ReportedObjects
    ) -> tuple[dict[int, HeldComponent], ReportedObjects]:
        """Histories enter with what they weigh: with objects that are one, or that place a robot, lost or carried."""
        if self.revision.is_on or self.relocation.is_on or self.recovery.is_on:
            self.steps.append(step)
        ratio = self.problem.pruning.ratio
        poses = {number: components[number].pose for number in self.live}
        places = {number: pose[:3] for number, pose in poses.items()}
        found: dict[int, Hypothesis] = {}
        if self.revision.is_on:
            objects = {number: components[number].objects for number in self.live}
            found |= self.revision.revised(Present(self.live, reported.ids, objects, self.log_evidence))
        found |= self.relocation.placed(self.live, self.log_evidence, ratio)
        found |= self.recovery.found(self.live, poses, self.log_evidence, ratio)
        if not found:
            return components, reported
        together, log_found = normalised(with_revised(self.live, found, places, self.problem))
        self.pool.offer({n: own.replayed for n, own in together.items() if own.replayed is not None})
        children, answers = self.rounds.commit(step.index, together)
        reported = self._reported(answers)
        components = held_components(answers, reported)
        self.hypotheses.enter(children, components, log_found)
        self.alternatives.enter(self.live)
        self.log_evidence += log_found
        self.copies.remember(self.live, {n: components[n].objects for n in self.live}, reported, self.registry)
        return components, reported

    def _reported(self, answers: list[Components]) -> ReportedObjects:
        """The objects of the components that backends hold."""
        return self.association.reported(self.registry, {n for answer in answers for n in answer.object_ids.tolist()})

    def weighted_components(
        self,
        step: Step,
        components: dict[int, HeldComponent],
        reported: ReportedObjects,
        candidates: CandidateTable,
        kept: Pruned,
    ) -> HybridBelief:
        """The belief {(b[X_k], w)} of Eq. 4.5, with its marginals: Eqs. 4.6-4.8."""
        discarded = self.hypotheses.discarded
        self.genuine.note(step)
        belief = state_belief(
            step,
            self._mixture(components, reported),
            reported,
            self.problem.class_names,
            self.problem.inferred_noise,
            state_space=self.problem.spaces.name,
            num_candidates=len(candidates.ids),
            discarded_mass=discarded.total,
            first_new_id=self.registry.first_new_id(step.index) if self.association.merges_copies else None,
            passed_over=PassedOver.of(candidates, kept),
        )
        return replace(
            belief,
            num_merged=self.copies.num_merged,
            reproducible=not self.budget.is_on,
            discarded_mass_window=discarded.window,
        )

    def judged(self, step: Step, belief: HybridBelief, candidates: CandidateTable, kept: Pruned) -> HybridBelief:
        """The belief with what tells whether it explains its data."""
        log_reference = self.reference.log_density(step, belief) if self.reference is not None else np.nan
        log_evidence = kept.log_mass - candidates.log_found  # of the keyframe alone
        self.recovery.note(log_reference - log_evidence)
        weights, outliers = np.exp(kept.log_weights), belief.outlier_probability
        if self.problem.detection_errors.outlier_share > 0.0:  # of no known object, or far from where it is
            outliers = np.nan_to_num(outliers) + weights @ candidates.outlier_probability[kept.kept]
        return replace(
            belief,
            outlier_probability=outliers,
            log_evidence=log_evidence,
            innovation_nees=mean_of_known(candidates.innovation_nees[kept.kept], weights),
            unexplained=self.explanation.add(log_evidence, log_reference),
        )

    def _in_map(self, held: HeldComponent, lineage: Lineage, reported: ReportedObjects) -> HeldComponent:
        """A component with the uncertainty of the map, where its robot is not placed and has a frame of its own."""
        starts, grounds = self.problem.starts, new_grounds(lineage) if self.recovery.is_on else ()
        if grounds:
            frame, first = self.recovery.frame(grounds), self.registry.first_new_id(grounds[0])
            held = in_map(held, frame, np.array([n < first for n in reported.ids], dtype=bool))
        if starts is None or self.problem.is_placed(lineage):
            return held
        known = self.problem.map_ids
        return in_map(held, starts, np.array([n in known for n in reported.ids], dtype=bool))

    def _as_believed(self, components: dict[int, HeldComponent]) -> dict[int, Hypothesis]:
        """The live hypotheses, heaviest first, with weights that count what their evidence is worth between places."""
        every, limits = list(self.live.items()), self.problem.pruning
        bagging = self.problem.bagging
        if bagging.num_replicates == 0 or limits.place_m <= 0.0:
            return self.live
        places = Kinds(
            positions=np.array([components[number].pose[:3] for number, _ in every]),
            beginnings=np.zeros(len(every), dtype=int),
        )
        log_weights = bagging.log_weights(
            np.array([own.log_weight for _, own in every]),
            np.array([own.replicates for _, own in every]),
            places.of(np.arange(len(every)), limits.place_m),
        )
        return {
            every[row][0]: replace(every[row][1], log_weight=float(log_weights[row]))
            for row in np.argsort(-log_weights, kind="stable").tolist()
        }

    def _as_scored(self, live: dict[int, Hypothesis], ids: Sequence[int], objects: ObjectTable) -> ObjectTable:
        """(H, O) objects, with what detectors' scores tell of whether they are things."""
        gone = objects.missing if objects.missing.size else np.zeros(objects.existence.shape)
        shares = self.genuine.shares(live, ids, np.minimum(objects.existence + np.nan_to_num(gone), 1.0))
        if shares is None:
            return objects
        missing = objects.missing * shares if objects.missing.size else objects.missing
        return replace(objects, existence=objects.existence * shares, missing=missing)

    def _mixture(self, components: dict[int, HeldComponent], reported: ReportedObjects) -> Mixture:
        """The live hypotheses, heaviest first."""
        live = self._as_believed(components)
        rows = [self._in_map(components[n], own.lineage, reported) for n, own in live.items()]
        objects = stack_rows([own.objects for own in rows])
        objects = self._as_scored(live, reported.ids, objects)
        return Mixture(
            ids=list(live),
            parent_ids=[own.told_parent_id for own in live.values()],
            log_weights=np.array([own.log_weight for own in live.values()]),
            lineages=[own.lineage for own in live.values()],
            changes=self.alternatives.told({n: live[n] for n in self.live}),
            poses=np.array([own.pose for own in rows]),
            pose_covariances=np.array([own.covariance for own in rows]),
            objects=objects,
            noise=np.array([own.noise for own in rows]),
        )
