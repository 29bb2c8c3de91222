"""A recorded run inferred again: it tells, besides its beliefs, what was pruned and what each view said.

Inference is a function of the recorded configuration, measurements and odometry, so that nothing has to be recorded for
this; hypotheses have the ids that they had, by which the run is known to be the same.
"""

from collections.abc import Collection, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from semantic_slam.errors import InputError
from semantic_slam.evaluation.record import Record
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.log_space import log_sum_exp
from semantic_slam.inference.backend import Backend
from semantic_slam.inference.belief import HybridBelief
from semantic_slam.inference.candidate_table import CandidateTable
from semantic_slam.inference.engine import Engine
from semantic_slam.inference.hypotheses import Hypothesis
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.protocol import Candidates, Commit, Components, RunConfiguration
from semantic_slam.inference.smoothing.component import Component
from semantic_slam.inference.world.problem import Problem

SAME_NATS = 1e-6
"""Largest difference of log weights and log odds between a run and its replay."""
COMPARED_PROBABILITY = 1e-12
"""Class probabilities below this are not compared: their logarithms are rounded where they are recorded."""


@dataclass(frozen=True, kw_only=True)
class ObjectOfHistory:
    """What one hypothesis knows of the class of one object; C classes."""

    log_class: Array  # (C,) log probabilities
    log_likelihood: Array | None  # (C,) of its views from where this hypothesis has them; None: it has none on record
    newest: Array | None  # (C,) of the newest of them given the others, where that is not what it added


@dataclass(frozen=True, kw_only=True)
class LiveHistory:
    """A hypothesis after a keyframe."""

    parent_id: int  # of the keyframe before, as beliefs tell it
    log_weight: float
    history: int  # equal for hypotheses with the same associations since the start, whatever their classes and modes
    association: tuple[int, ...]  # (D,) object ids in this keyframe, -1 clutter
    is_revised: bool  # its history was not its parent's
    changes: tuple[tuple[int, int, int], ...]  # keyframe, detection, object or -1: where it differs from its parent's
    objects: dict[int, ObjectOfHistory]


@dataclass(frozen=True, kw_only=True)
class ReplayedKeyframe:
    """One keyframe as it was recorded, and what was weighed in it."""

    belief: HybridBelief  # recorded
    candidates: CandidateTable  # all of them, before copies are merged and before the light ones are pruned
    live: dict[int, LiveHistory]


@dataclass(frozen=True, kw_only=True)
class ReplayedRun:
    """All keyframes of a run with what was said of some objects."""

    problem: Problem
    root_ids: tuple[int, ...]
    log_class_prior: dict[int, Array]  # object id -> (C,)
    keyframes: tuple[ReplayedKeyframe, ...]  # K
    largest_difference: float  # nats, of log weights and log class probabilities, to what was recorded

    @property
    def is_same(self) -> bool:
        """Whether the replay gives what was recorded."""
        return self.largest_difference <= SAME_NATS

    def on_map(self, object_id: int) -> int:
        """The number under which an object is reported, wherever a hypothesis has it."""
        return self.problem.displaced.on_map.get(object_id, object_id)

    @cached_property
    def enumerates_classes(self) -> bool:
        """Whether each hypothesis has one class for an object, and others have the other ones."""
        return int(getattr(self.problem.model, "num_classes", 0)) > 0


class _WatchedPool:
    """One backend in this process, whose newest candidates and components can be looked at."""

    def __init__(self) -> None:
        self.backend_ids: tuple[int, ...] = (0,)
        self._backend = Backend(0)
        self.answers: list[Candidates] = []

    def start(self, run: RunConfiguration) -> None:
        self._backend.start(run)

    def expand(self, keyframe: Keyframe) -> list[Candidates]:
        self.answers = [self._backend.expand(keyframe)]
        return self.answers

    def commit(self, commit: Commit) -> list[Components]:
        answer = self._backend.commit(commit)
        return [] if answer is None else [answer]

    def component(self, number: int) -> Component:
        return self._backend.held[number].component


def replay(record: Record, keyframes: Iterable[Keyframe], object_ids: Collection[int]) -> ReplayedRun:
    """Infer a recorded run again and note what is said of the objects asked for.

    Raises InputError where keyframes or hypotheses are not those recorded.
    """
    pool = _WatchedPool()
    engine = Engine.of_run(record.run, pool)
    root_ids, told = tuple(engine.live), list[ReplayedKeyframe]()
    histories = dict.fromkeys(root_ids, 0)
    largest = 0.0
    for belief, keyframe in zip(record.beliefs, keyframes, strict=False):
        if keyframe.stamp_ns != belief.stamp_ns:
            raise _not_the_same(record, belief)
        again = engine.process(keyframe)
        largest = max(largest, _difference(record, belief, again))
        aliases = {n: _aliases(engine.problem, n) for n in object_ids}
        live = {n: _live(own, histories, pool.component(n), aliases, engine) for n, own in engine.live.items()}
        histories = {n: own.history for n, own in live.items()}
        told.append(ReplayedKeyframe(belief=belief, candidates=CandidateTable.of(pool.answers), live=live))
    if len(told) < len(record.beliefs):
        raise _not_the_same(record, record.beliefs[len(told)])
    prior = {n: engine.registry.log_class_prior_of([n])[0] for n in object_ids}
    return ReplayedRun(
        problem=engine.problem,
        root_ids=root_ids,
        log_class_prior=prior,
        keyframes=tuple(told),
        largest_difference=largest,
    )


def _aliases(problem: Problem, object_id: int) -> tuple[int, ...]:
    """Numbers that hypotheses may have an object under."""
    elsewhere = problem.displaced.elsewhere.get(object_id)
    return (object_id,) if elsewhere is None else (object_id, elsewhere)


def _live(
    own: Hypothesis,
    histories: dict[int, int],
    component: Component,
    aliases: dict[int, tuple[int, ...]],
    engine: Engine,
) -> LiveHistory:
    association = own.lineage[-1].association
    is_revised = own.parent_id not in histories or own.revises is not None
    if is_revised:
        history = 0
        for step in own.lineage:
            history = hash((history, step.association))
    else:
        history = hash((histories[own.parent_id], association))
    return LiveHistory(
        parent_id=own.told_parent_id,
        log_weight=own.log_weight,
        history=history,
        association=association,
        is_revised=is_revised,
        changes=tuple(own.changes()),
        objects={n: _object(component, names, n, engine) for n, names in aliases.items()},
    )


def _object(component: Component, names: tuple[int, ...], object_id: int, engine: Engine) -> ObjectOfHistory:
    prior = engine.registry.log_class_prior_of([object_id])[0]
    record = next((component.views[n] for n in names if n in component.views), None)
    likelihood = None if record is None or len(record.log_likelihood) != len(prior) else record.log_likelihood
    enumerated = next((component.classes[n] for n in names if n in component.classes), None)
    if enumerated is not None:
        log_class = np.where(np.arange(len(prior)) == enumerated, 0.0, -np.inf)
    else:
        joint = prior if likelihood is None else prior + likelihood
        log_class = joint - log_sum_exp(joint) if len(joint) else joint
    newest = None if record is None or likelihood is None else record.newest
    return ObjectOfHistory(log_class=log_class, log_likelihood=likelihood, newest=newest)


def _difference(record: Record, belief: HybridBelief, again: HybridBelief) -> float:
    """Largest difference, in nats, of log weights and of log class probabilities. Raises InputError."""
    if sorted(belief.hypothesis_ids.tolist()) != sorted(again.hypothesis_ids.tolist()):
        raise _not_the_same(record, belief)
    places = {number: row for row, number in enumerate(again.hypothesis_ids.tolist())}
    rows = np.array([places[number] for number in belief.hypothesis_ids.tolist()], dtype=int)
    largest = float(np.abs(belief.log_weights - again.log_weights[rows]).max())
    if not np.array_equal(belief.object_ids, again.object_ids):
        raise _not_the_same(record, belief)
    before, after = belief.hypothesis_class_probabilities, again.hypothesis_class_probabilities[rows]
    compared = (before > COMPARED_PROBABILITY) | (after > COMPARED_PROBABILITY)
    if compared.any():
        with np.errstate(divide="ignore"):
            largest = max(largest, float(np.abs(np.log(before[compared]) - np.log(after[compared])).max()))
    return largest


def _not_the_same(record: Record, belief: HybridBelief) -> InputError:
    made_by: Any = record.run.revision or "not recorded"
    return InputError(
        f"keyframe {belief.keyframe}: inferred again, the hypotheses are not those recorded; explain with the version"
        f" that recorded the bag (revision {made_by}), and without open_world.time_budget_ms, which no replay repeats"
    )
