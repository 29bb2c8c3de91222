"""Alternative associations of detections: their probability, and how they ended."""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from semantic_slam.answers.explain.ledger import ClassLedger
from semantic_slam.answers.explain.live_history import LiveHistory
from semantic_slam.answers.explain.replayed_run import ReplayedKeyframe, ReplayedRun
from semantic_slam.answers.explain.sightings import object_name
from semantic_slam.geometry.arrays import Flags

LEAST_PROBABLE = 0.01
"""Smallest probability of a reported alternative."""


@dataclass(frozen=True, kw_only=True)
class Rival:
    """One alternative association of one detection."""

    keyframe: int
    detection: int
    taken_id: int  # object in the history; -1: clutter
    object_id: int  # alternative object
    then: float  # probability among all candidates weighed in the keyframe
    now: float  # weight of the final histories that have it
    gone: int | None  # keyframe in which the last history with it was pruned; None: one survives
    log_odds_before: float  # best history with it against the best of all, one keyframe earlier; NaN: none yet
    log_odds: float  # against the best of all when pruned; -inf: nothing continued it
    by: tuple[str, ...]  # objects that the best history observed in that keyframe


def rivals(run: ReplayedRun, ledger: ClassLedger) -> tuple[Rival, ...]:
    """Alternatives of the object's views, and views of others that might have been of this object."""
    found = []
    for k, own in enumerate(ledger.steps):
        for detection, number in enumerate(() if own is None else own.association):
            taken = run.on_map(number)
            for other, then in _alternatives(run, k, detection):
                if other != taken and ledger.object_id in (other, taken):
                    found.append(_rival(run, k, detection, (taken, other), then))
    return tuple(found)


def _alternatives(run: ReplayedRun, k: int, detection: int) -> list[tuple[int, float]]:
    """Possible objects of a detection with probabilities, most likely first."""
    candidates = run.keyframes[k].candidates
    weights = np.exp(candidates.log_weights - candidates.log_weights.max())
    numbers, places = np.unique(candidates.associations[:, detection], return_inverse=True)
    total: dict[int, float] = {}
    for number, mass in zip(numbers.tolist(), np.bincount(places, weights).tolist(), strict=True):
        total[run.on_map(number)] = total.get(run.on_map(number), 0.0) + mass / float(weights.sum())
    return sorted(((n, p) for n, p in total.items() if p >= LEAST_PROBABLE), key=lambda item: -item[1])


def _rival(run: ReplayedRun, k: int, detection: int, numbers: tuple[int, int], then: float) -> Rival:
    """Evaluate one alternative; ``numbers``: the associated object and the alternative one."""
    taken, other = numbers
    place = run.keyframes[k].belief.keyframe, detection
    at, parents = k, frozenset[int]()
    alive = {n for n, own in run.keyframes[k].live.items() if run.on_map(own.association[detection]) == other}
    while alive and at + 1 < len(run.keyframes):
        at, parents = at + 1, frozenset(alive)
        alive = {n for n, own in run.keyframes[at].live.items() if _has(run, own, place, other, parents)}
    keyframe = run.keyframes[at]
    if alive:
        rows = [own.log_weight for n, own in keyframe.live.items() if n in alive]
        odds = before = _against_best(keyframe, alive)
    else:
        rows, candidates = [], keyframe.candidates
        with_it = (
            np.isin(candidates.parent_ids, list(parents))
            if parents
            else np.array([run.on_map(n) == other for n in candidates.associations[:, detection].tolist()])
        )
        odds = _weighed_against_best(keyframe, with_it)
        before = _against_best(run.keyframes[at - 1], parents) if parents else np.nan
    return Rival(
        keyframe=place[0],
        detection=detection,
        taken_id=taken,
        object_id=other,
        then=then,
        now=float(np.exp(rows).sum()),
        gone=None if alive else keyframe.belief.keyframe,
        log_odds_before=before,
        log_odds=odds,
        by=_seen_by_best(run, keyframe),
    )


def _has(run: ReplayedRun, own: LiveHistory, place: tuple[int, int], other: int, parents: Collection[int]) -> bool:
    """Whether a history has the alternative, inherited from one of ``parents`` or by revision."""
    changed = [number for keyframe, detection, number in own.changes if (keyframe, detection) == place]
    return run.on_map(changed[0]) == other if changed else own.parent_id in parents


def _against_best(keyframe: ReplayedKeyframe, numbers: Collection[int]) -> float:
    weights = [own.log_weight for own in keyframe.live.values()]
    return max(keyframe.live[n].log_weight for n in numbers) - max(weights)


def _weighed_against_best(keyframe: ReplayedKeyframe, rows: Flags) -> float:
    weights = keyframe.candidates.log_weights
    return float(weights[rows].max() - weights.max()) if rows.any() else float("-inf")


def _seen_by_best(run: ReplayedRun, keyframe: ReplayedKeyframe) -> tuple[str, ...]:
    best = max(keyframe.live.values(), key=lambda own: own.log_weight)
    return tuple(object_name(keyframe.belief, run.on_map(n)) for n in best.association if n >= 0)
