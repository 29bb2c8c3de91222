"""Replay of a recorded run's inference, which also yields pruned candidates and per-view evidence.

Inference is a deterministic function of the recorded configuration, measurements and odometry, so nothing extra has to
be recorded; hypotheses get the ids that they had, by which the replay is verified.
"""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import takewhile
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from semantic_slam.answers.explain.live_history import LiveHistory, ObjectOfHistory, object_of
from semantic_slam.answers.explain.revised_history import replayed_history
from semantic_slam.errors import InputError
from semantic_slam.evaluation.record import Record
from semantic_slam.geometry.arrays import Array
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
"""Largest difference [nats] of log weights and log odds at which a replay counts as identical."""
MOST_REPLAYED = 5
"""Number of heaviest final hypotheses whose revised histories are replayed from the start."""
COMPARED_PROBABILITY = 1e-12
"""Class probabilities below this are not compared: their recorded logarithms are rounded."""


@dataclass(frozen=True, kw_only=True)
class WeighedCandidates:
    """All candidates of a keyframe, before duplicates are merged and light ones pruned; D detections."""

    ids: NDArray[np.uint64]  # (K,)
    parent_ids: NDArray[np.uint64]  # (K,)
    associations: NDArray[np.int32]  # (K, D) object ids, -1 clutter
    classes: NDArray[np.int32]  # (K, D) -1 where a class is not enumerated or undecided
    log_weights: Array  # (K,) not normalised

    @classmethod
    def of(cls, answers: Sequence[Candidates]) -> Self:
        """Candidates from the backends' answers, without the states."""
        table = CandidateTable.of(answers)
        return cls(**{name: getattr(table, name) for name in cls.__dataclass_fields__})


@dataclass(frozen=True, kw_only=True)
class ReplayedKeyframe:
    """One recorded keyframe and the candidates weighed in it."""

    belief: HybridBelief  # recorded, or from the replay where not recorded
    candidates: WeighedCandidates
    live: dict[int, LiveHistory]


@dataclass(frozen=True, kw_only=True)
class ReplayedRun:
    """All keyframes of a replayed run, with class information on the watched objects."""

    problem: Problem
    root_ids: tuple[int, ...]
    log_class_prior: dict[int, Array]  # object id -> (C,)
    keyframes: tuple[ReplayedKeyframe, ...]  # K
    revised: Mapping[int, tuple[LiveHistory, ...]]  # final hypothesis -> (K,) its history as revised
    largest_difference: float  # nats, of log weights and log class probabilities, to the recording

    @property
    def is_same(self) -> bool:
        """Whether the replay reproduces the recording."""
        return self.largest_difference <= SAME_NATS

    def on_map(self, object_id: int) -> int:
        """Reported id of an object, which a hypothesis may hold under another id (displaced objects)."""
        return self.problem.displaced.on_map.get(object_id, object_id)

    def path(self, number: int) -> list[LiveHistory | None]:
        """(K,) history of a final hypothesis after every keyframe; None where it had none yet."""
        if number in self.revised:
            return list(self.revised[number])
        numbers = ancestors(self.keyframes, number)
        return [None if n is None else self.keyframes[k].live[n] for k, n in enumerate(numbers)]


class _WatchedPool:
    """In-process pool with one backend, whose newest candidates and components can be inspected."""

    def __init__(self) -> None:
        self.backend_ids: tuple[int, ...] = (0,)
        self._backend = Backend(0)
        self.answers: list[Candidates] = []

    def start(self, run: RunConfiguration) -> None:
        self._backend.start(run)

    def begin(self, keyframe: Keyframe) -> None:
        pass

    def expand(self, keyframe: Keyframe) -> list[Candidates]:
        self.answers = [self._backend.expand(keyframe)]
        return self.answers

    def commit(self, commit: Commit) -> list[Components]:
        answer = self._backend.commit(commit)
        return [] if answer is None else [answer]

    def offer(self, components: Mapping[int, Component]) -> None:
        self._backend.offer(components)

    def component(self, number: int) -> Component:
        return self._backend.held[number].component


def replay(record: Record, keyframes: Iterable[Keyframe], object_ids: Collection[int]) -> ReplayedRun:
    """Replay a recorded run and collect class information on the given objects.

    Beliefs before the last one that were not recorded are taken from the replay. Raises InputError where keyframes or
    hypotheses differ from the recording.
    """
    pool = _WatchedPool()
    engine = Engine.of_run(record.run, pool)
    root_ids, replayed = tuple(engine.live), list[ReplayedKeyframe]()
    names = {n: _names(engine.problem, n) for n in object_ids}
    prior = dict[int, Array]()
    histories, largest = dict.fromkeys(root_ids, 0), 0.0
    recorded = {belief.keyframe: belief for belief in record.beliefs}
    for keyframe in takewhile(lambda own: own.index <= record.beliefs[-1].keyframe, keyframes):
        belief = recorded.get(keyframe.index)
        if belief is not None and keyframe.stamp_ns != belief.stamp_ns:
            raise _not_the_same(record, belief)
        again = engine.process(keyframe)
        if belief is not None:
            largest = max(largest, _difference(record, belief, again))
        prior = {n: engine.registry.log_class_prior_of([n])[0] for n in object_ids}
        poses = dict(zip(again.hypothesis_ids.tolist(), again.poses, strict=True))
        live = {}
        for number, own in engine.live.items():
            component = pool.component(number)
            objects = {n: object_of(component, names[n], prior[n]) for n in object_ids}
            live[number] = _live(own, histories, poses[number], objects)
        histories = {n: own.history for n, own in live.items()}
        candidates = WeighedCandidates.of(pool.answers)
        replayed.append(ReplayedKeyframe(belief=again if belief is None else belief, candidates=candidates, live=live))
    missing = [belief for number, belief in recorded.items() if number >= len(replayed)]
    if missing:
        raise _not_the_same(record, missing[0])
    revised = _revised(engine, replayed, names, prior)
    for number, path in revised.items():
        largest = max(largest, _difference_of_end(path[-1], replayed[-1].live[number]))
    return ReplayedRun(
        problem=engine.problem,
        root_ids=root_ids,
        log_class_prior=prior,
        keyframes=tuple(replayed),
        revised=revised,
        largest_difference=largest,
    )


def _names(problem: Problem, object_id: int) -> tuple[int, ...]:
    """Ids under which hypotheses may hold an object."""
    elsewhere = problem.displaced.elsewhere.get(object_id)
    return (object_id,) if elsewhere is None else (object_id, elsewhere)


def _live(own: Hypothesis, before: dict[int, int], pose: Array, objects: dict[int, ObjectOfHistory]) -> LiveHistory:
    """State of one hypothesis after a keyframe; ``before``: histories of the previously live hypotheses."""
    association = own.lineage[-1].association
    is_revised = own.parent_id not in before or own.revises is not None
    history = 0 if is_revised else before[own.parent_id]
    for step in own.lineage if is_revised else own.lineage[-1:]:
        history = hash((history, step.association))
    return LiveHistory(
        parent_id=own.told_parent_id,
        log_weight=own.log_weight,
        history=history,
        association=association,
        is_revised=is_revised,
        changes=tuple(own.changes()),
        pose=pose,
        objects=objects,
    )


def _revised(
    engine: Engine, replayed: Sequence[ReplayedKeyframe], names: dict[int, tuple[int, ...]], prior: dict[int, Array]
) -> dict[int, tuple[LiveHistory, ...]]:
    """Replayed histories of the heaviest final hypotheses whose histories were revised on the way."""
    if not engine.steps or enumerates_classes(engine.problem):
        return {}
    found = {}
    for number in list(engine.live)[:MOST_REPLAYED]:
        path = [None if n is None else replayed[k].live[n] for k, n in enumerate(ancestors(replayed, number))]
        if any(own is None or own.is_revised for own in path):
            found[number] = replayed_history(engine, engine.live[number].lineage, names, prior)
    return found


def ancestors(replayed: Sequence[ReplayedKeyframe], number: int) -> list[int | None]:
    """Ancestor ids of a final hypothesis, keyframe by keyframe; None where it had no history yet."""
    path: list[int | None] = []
    own: int | None = number
    for keyframe in reversed(replayed):
        live = keyframe.live.get(own) if own is not None else None
        path.append(own if live is not None else None)
        own = live.parent_id if live is not None else None
    return path[::-1]


def enumerates_classes(problem: Problem) -> bool:
    """Whether hypotheses enumerate object classes, one class per object and hypothesis."""
    return int(getattr(problem.model, "num_classes", 0)) > 0


def _difference_of_end(some: LiveHistory, other: LiveHistory) -> float:
    """Largest difference [nats] between the final log class probabilities of two histories."""
    pairs = [(own.log_class, other.objects[number].log_class) for number, own in some.objects.items()]
    return max((float(np.abs(one - two).max(initial=0.0)) for one, two in pairs), default=0.0)


def _difference(record: Record, belief: HybridBelief, again: HybridBelief) -> float:
    """Largest difference [nats] of log weights and log class probabilities. Raises InputError."""
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
    if late := record.begun_late:
        return InputError(f"{late}; ask ~/explain of the running manager, or record a run from its start")
    made_by: Any = record.run.revision or "not recorded"
    return InputError(
        f"keyframe {belief.keyframe}: inferred again, the hypotheses are not those recorded; explain with the version"
        f" that recorded the bag (revision {made_by}), and without open_world.time_budget_ms, which no replay repeats"
    )
