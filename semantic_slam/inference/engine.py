"""The engine: recursive inference of the hybrid belief over poses, classes and data association (Algorithm 4.1).

A hypothesis is one history of data associations (and classes); its component is the factor graph (iSAM2) conditioned
on that history, and the belief is the weighted mixture of all components. Per keyframe the engine expands all
hypotheses, prunes over all of them and commits the survivors to the backends that hold the components.

The printed algorithm normalises inside the loop over components, which loses each parent's weight and evidence; here
the unnormalised weights w psi are collected over all parents and normalised once.
"""

from collections import Counter
from dataclasses import replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from semantic_slam.configuration import Configuration, PruningConfiguration
from semantic_slam.errors import InputError
from semantic_slam.inference.alternatives.alternatives import Alternatives, NoAlternatives
from semantic_slam.inference.association.strategy import AssociationStrategy
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.building import make_run_configuration, problem_of, reference_of, start_of_run
from semantic_slam.inference.candidate_table import CandidateTable
from semantic_slam.inference.evidence.model_fit import ModelFit, mean_of_known
from semantic_slam.inference.hypotheses import Hypotheses, Hypothesis
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.kept_steps import KeptSteps
from semantic_slam.inference.marginals import state_belief
from semantic_slam.inference.models.step import Step
from semantic_slam.inference.open_world.copies import Copies, Distinct
from semantic_slam.inference.open_world.genuine_objects import GenuineObjects
from semantic_slam.inference.open_world.time_budget import TimeBudget
from semantic_slam.inference.pool import InProcessPool
from semantic_slam.inference.protocol import BackendPool, RunConfiguration
from semantic_slam.inference.pruning import Kinds, Pruned, affordable, most_of_a_kind, prune, widened
from semantic_slam.inference.relocation.carried_spans import CarriedSpans
from semantic_slam.inference.relocation.recovery import Recovery
from semantic_slam.inference.relocation.relocation import Relocation
from semantic_slam.inference.revision.looking_back import Present
from semantic_slam.inference.revision.replay import REACH, Replay
from semantic_slam.inference.revision.revision import Revision, normalised, with_revised
from semantic_slam.inference.revision.storable_replay import StorableReplay
from semantic_slam.inference.rounds import Committed, Rounds, held_components
from semantic_slam.inference.statement import Statement
from semantic_slam.inference.summarised_copies import SummarisedCopies
from semantic_slam.inference.world.carried import is_carried_lately
from semantic_slam.inference.world.map_prior import MapPrior
from semantic_slam.inference.world.objects import ObjectRegistry
from semantic_slam.inference.world.problem import Problem
from semantic_slam.state import restore, state_of


class Engine:
    """Runs the hybrid inference of one run: drives the backends through the two rounds of each keyframe."""

    STATE: ClassVar[tuple[str, ...]] = (
        "_reader",
        "registry",
        "hypotheses",
        "rounds",
        "copies",
        "alternatives",
        "genuine",
        "reference",
        "recovery",
        "carried_spans",
        "model_fit",
        "log_evidence",
        "_last_stamp_ns",
    )

    def __init__(
        self,
        configuration: Configuration,
        map_prior: MapPrior | None = None,
        *,
        initial_pose: ArrayLike | None = None,
        initial_covariance: ArrayLike | None = None,
        backends: int = 1,
    ) -> None:
        """Start a run with ``backends`` in this process.

        ``initial_pose`` is the robot's pose in map before the first keyframe: (3,) x, y, yaw or a (7,) pose vector.
        ``initial_covariance`` is (3, 3) or (6, 6), along the axes of map. Whichever of the two is None is taken from
        the configuration's ``initial_pose``. Raises InputError.
        """
        pose, covariance = start_of_run(configuration, initial_pose, initial_covariance)
        run = make_run_configuration(configuration, map_prior, pose, covariance, stamp_ns=0)
        self._start(run, InProcessPool(backends), None)

    @classmethod
    def of_run(cls, run: RunConfiguration, pool: BackendPool, problem: Problem | None = None) -> Self:
        """Start an announced run with the backends of ``pool``.

        ``problem`` replaces the problem built from the run's configuration. There is no null model for such a problem
        (its detection region is unknown), so that the belief's ``unexplained`` is NaN.
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
        self.alternatives = Alternatives(self.problem, list(self.hypotheses.live)) if merges else NoAlternatives()
        self.budget = TimeBudget(self.problem.open_world.time_budget_ms, self.problem.pruning)
        self.genuine = GenuineObjects(
            self.problem.open_world, self.problem.detection_errors, counts_misses=self.association.counts_misses
        )
        association = self.association(self.problem, self.registry)
        # Of all keyframes so far; filled only if histories may be replayed.
        self.steps = KeptSteps(in_memory=REACH * self.problem.history.horizon_keyframes or None)
        dissolves = self.problem.spaces.name == "spatial" or self.problem.revision.second_boxes_every_keyframes > 0
        anew = self.registry if dissolves else None
        replay = Replay(self.problem, association, self.steps, anew)
        self.revision = Revision(self.problem.revision, replay, self.registry)
        self.relocation = Relocation(
            self.problem.revision, Replay(self.problem, association, self.steps), self.registry
        )
        self.recovery = Recovery(
            self.problem.revision, StorableReplay(self.problem, association, self.steps), self.registry
        )
        self.statement = Statement(self.problem, self.registry, self.genuine, self.recovery, self.alternatives)
        self.carried_spans = CarriedSpans()
        self.model_fit = ModelFit()
        self.log_evidence = 0.0  # log P(Z_1:k) under the hypotheses kept, in nats
        self._last_stamp_ns: int | None = None  # of the newest keyframe; None before the first one

    @property
    def may_be_stored(self) -> bool:
        """Whether :meth:`state` is all that the engine needs: no history is under way beside the live ones.

        Nor may any be proposed later, but those of a robot that is carried.
        """
        return self.revision.is_over and self.relocation.is_over and self.recovery.may_be_stored

    def state(self) -> dict[str, Any]:
        """What the run so far has made of the engine, as long as it ``may_be_stored``; backends' components apart."""
        first = self.recovery.first_step
        steps = [] if first is None else self.steps[first:]
        return {"own": state_of(self), "stamps_ns": self.steps.stamps_ns, "steps": steps}

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from a state of an engine of the same run. Raises ValueError or KeyError for any other."""
        self.steps.go_on(state["stamps_ns"], state["steps"])
        restore(self, state["own"])

    @property
    def _reader(self) -> Any:
        return self.problem.reader

    def _copies_of_known_objects(self) -> Distinct | SummarisedCopies:
        return SummarisedCopies(self.problem) if self.problem.history.is_on else Distinct()

    @property
    def live(self) -> dict[int, Hypothesis]:
        """The live hypotheses by id, in descending order of weight."""
        return self.hypotheses.live

    @property
    def carried(self) -> float:
        """Probability that the robot was kidnapped (carried elsewhere) recently, or earlier and is still unlocalised.

        The weight of the hypotheses whose lineage has a kidnapping in the last ``SOON`` keyframes, or has the robot in
        a separate frame ("new ground") since an earlier one. 0 where kidnapping is not modelled.
        """
        if not self.recovery.is_on:
            return 0.0
        carried = [
            hypothesis
            for hypothesis in self.live.values()
            if is_carried_lately(hypothesis.lineage) or hypothesis.grounds
        ]
        weights = [hypothesis.log_weight for hypothesis in carried]
        return float(np.exp(np.logaddexp.reduce(weights))) if weights else 0.0

    @property
    def lost(self) -> Counter[str]:
        """Number of hypotheses that backends had to give up, by reason."""
        return self.rounds.lost

    def process(self, keyframe: Keyframe) -> HybridBelief:
        """Update the belief with one keyframe (Algorithm 4.1). Raises SemanticSlamError when no hypothesis survives."""
        self.budget.begin()
        step = self.introduce(keyframe)
        self.pool.begin(keyframe)
        if self.revision.is_on:
            self.revision.go_on()  # while backends in other processes weigh
        weighed = self.propagate_weights(keyframe, step)  # of all continuations of every component with w > 0
        candidates = self.copies.merged(weighed)
        kept = self.prune_and_normalise(step, candidates)
        committed = self.add_observation_factors(step, candidates, kept)  # only for survivors, w > 0
        self.alternatives.follow(weighed, self.live, committed.components)
        committed = self.revise(step, committed)
        self.budget.end(len(self.hypotheses))
        belief = self.weighted_components(step, committed, candidates, kept)
        return self.judged(step, belief, candidates, kept)

    def introduce(self, keyframe: Keyframe) -> Step:
        """Convert a keyframe to the engine's input: action u_k-1 and measurements Z_k, in the order of the detections.

        The association strategy registers the objects that the detections may introduce, so that these have ids.
        Raises InputError, also for a keyframe out of sequence.
        """
        self._check_sequence(keyframe)
        step = self.problem.reader.step(keyframe)
        self.association.introduce(self.registry, step)
        if self.revision.is_on or self.relocation.is_on or self.recovery.is_on:
            self.steps.append(step)
        self._last_stamp_ns = keyframe.stamp_ns
        return step

    def _check_sequence(self, keyframe: Keyframe) -> None:
        """Raise InputError for a keyframe out of sequence: one of another index, or earlier than the one before."""
        index, stamp_ns, last_ns = keyframe.index, keyframe.stamp_ns, self._last_stamp_ns
        if index != self.hypotheses.num_keyframes:
            raise InputError(
                f"keyframe {index} came in place of {self.hypotheses.num_keyframes}; number them without a gap"
            )
        if last_ns is not None and stamp_ns < last_ns:
            raise InputError(
                f"keyframe {index}: its stamp of {stamp_ns} ns is before the {last_ns} ns of keyframe {index - 1}; give"
                " keyframes in the order of time, and start another run where the clock was set back"
            )

    def propagate_weights(self, keyframe: Keyframe, step: Step) -> CandidateTable:
        """PropWeights: predict every component and weigh each association beta_k of Z_k, w psi (Eqs. 4.18-4.21).

        This happens in the backends that hold the components, see ``Expander.expand``.
        """
        return self.rounds.expand(keyframe, step.index)

    def prune_and_normalise(self, step: Step, candidates: CandidateTable) -> Pruned:
        """PruneAndNormalize over the candidates of all parents at once; the discarded mass is accounted for.

        Pruning is relaxed while the data are poorly explained (``unexplained``, see ``widened``).
        """
        limits = widened(self._limits(step), self.model_fit.unexplained)
        kinds = Kinds(
            positions=candidates.poses[:, :3],
            root_numbers=self.hypotheses.root_numbers(candidates, self.problem),
            most=most_of_a_kind(limits, len(step.detections)),
        )
        ordinary = self.recovery.not_carried(self.live, candidates.parent_ids)
        kept = prune(candidates.log_weights, candidates.ids, candidates.log_missing, limits, kinds, ordinary)
        self.log_evidence += kept.log_mass
        return kept

    def _limits(self, step: Step) -> PruningConfiguration:
        """Pruning limits at a keyframe: fewer hypotheses in a long run, or where time is short."""
        return affordable(self.budget.limits(), step.index + 1)

    def add_observation_factors(self, step: Step, candidates: CandidateTable, kept: Pruned) -> Committed:
        """Add the factors of Z_k to the survivors' components (Eqs. 4.9 and 4.10).

        A component whose linear system is indeterminate is dropped together with its hypothesis.
        """
        committed = self._commit(step.index, self.hypotheses.children(candidates, kept, self.pool.backend_ids))
        self.hypotheses.accept(committed.hypotheses, committed.components, kept.discarded)
        self.hypotheses.discarded.find(candidates.log_found)
        self._remember(committed)
        return committed

    def revise(self, step: Step, committed: Committed) -> Committed:
        """Let revised association histories enter the mixture with their own weights, if any were found.

        These correct past associations in hindsight (``revision``: duplicate objects, wrong loop closures), localise a
        lost robot in the map (``relocation``: global localisation), or explain the data by a kidnapped robot
        (``recovery``). Returns what is committed in the end.
        """
        limits, ratio = self._limits(step), self.problem.pruning.ratio
        components = committed.components
        poses = {number: components[number].pose for number in self.live}
        places = {number: pose[:3] for number, pose in poses.items()}
        found: dict[int, Hypothesis] = {}
        if self.revision.is_on:
            objects = {number: components[number].objects for number in self.live}
            found |= self.revision.revised(Present(self.live, committed.reported.ids, objects, self.log_evidence))
        found |= self.relocation.placed(self.live, self.log_evidence, ratio)
        found |= self.recovery.found(self.live, poses, self.log_evidence, ratio)
        if not found:
            return committed
        most = most_of_a_kind(limits, len(step.detections))
        together, log_found = normalised(with_revised(self.live, found, places, self.problem, limits, most))
        self.pool.offer(
            {n: hypothesis.replayed for n, hypothesis in together.items() if hypothesis.replayed is not None}
        )
        committed = self._commit(step.index, together)
        self.hypotheses.enter(committed.hypotheses, committed.components, log_found)
        self.alternatives.enter(self.live)
        self.log_evidence += log_found
        self._remember(committed)
        return committed

    def _commit(self, index: int, hypotheses: dict[int, Hypothesis]) -> Committed:
        """Have the backends hold the components of these hypotheses after keyframe ``index``, and report them."""
        hypotheses, answers = self.rounds.commit(index, hypotheses)
        alive = {object_id for answer in answers for object_id in answer.object_ids.tolist()}
        reported = self.association.reported(self.registry, alive)
        return Committed(
            hypotheses=hypotheses,
            components=held_components(answers, reported),
            reported=reported,
        )

    def _remember(self, committed: Committed) -> None:
        """Keep of the live hypotheses what near copies among the next candidates are recognised by."""
        objects = {number: committed.components[number].objects for number in self.live}
        self.copies.remember(self.live, objects, committed.reported, self.registry)

    def weighted_components(
        self,
        step: Step,
        committed: Committed,
        candidates: CandidateTable,
        kept: Pruned,
    ) -> HybridBelief:
        """State the belief {(b[X_k], w)} of Eq. 4.5, with its marginals (Eqs. 4.6-4.8)."""
        discarded = self.hypotheses.discarded
        self.genuine.note(step)
        belief = state_belief(
            step,
            self.statement.mixture(self.live, committed.components, committed.reported),
            committed.reported,
            self.problem,
            candidates,
            kept,
            discarded_mass=discarded.total,
            first_new_id=self.registry.first_new_id(step.index) if self.association.merges_copies else None,
        )
        return replace(
            belief,
            num_merged=self.copies.num_merged,
            reproducible=not self.budget.is_on,
            discarded_mass_window=discarded.window,
        )

    def judged(self, step: Step, belief: HybridBelief, candidates: CandidateTable, kept: Pruned) -> HybridBelief:
        """Add diagnostics of model fit to the belief: evidence, innovation NEES, outlier probabilities, `unexplained`.

        ``unexplained`` compares the belief's evidence with that of the null model, see ``Reference``.
        """
        log_reference = self.reference.log_density(step, belief) if self.reference is not None else np.nan
        log_evidence = kept.log_mass - candidates.log_found  # of this keyframe alone, without the mass found again
        self.recovery.note(log_reference - log_evidence)
        self.carried_spans.note(step.index, self.carried)
        weights, outliers = np.exp(kept.log_weights), belief.outlier_probability
        if self.problem.detection_errors.outlier_share > 0.0:  # clutter, or of a known object but far from it
            outliers = np.nan_to_num(outliers) + weights @ candidates.outlier_probability[kept.kept]
        return replace(
            belief,
            outlier_probability=outliers,
            log_evidence=log_evidence,
            innovation_nees=mean_of_known(candidates.innovation_nees[kept.kept], weights),
            unexplained=self.model_fit.add(log_evidence, log_reference),
        )
