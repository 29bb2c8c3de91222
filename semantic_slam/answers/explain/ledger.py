"""Class evidence of each keyframe for an object, in nats, along one association history.

Hypotheses with the same association history differ in classes and modes. Their total weight per class is

    M_k(c) = sum_h w_h P(c | h),    P(c | associations, Z_1:k) ~ M_k(c),

and the evidence of keyframe k is log p(Z_k | c, Z_1:k-1) = log M'_k(c) - log M_k-1(c), up to a constant, where M' is
the mass before pruning. Keyframes that observe the object are its views. Everything else is summed in one item: later
information about earlier views (robot poses, detector settings), pruning, and revised histories.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.answers.explain.live_history import LiveHistory
from semantic_slam.answers.explain.replayed_run import ReplayedKeyframe, ReplayedRun, enumerates_classes
from semantic_slam.geometry.arrays import Array, Flags
from semantic_slam.geometry.log_space import log_sum_exp


@dataclass(frozen=True, kw_only=True)
class PairLedger:
    """Class c against class c' in nats: ``prior`` + the sum of ``views`` + ``revised`` = ``log_odds``; V views."""

    views: Array  # (K,) NaN at keyframes without a view, and after ``until``
    prior: float
    revised: float  # net revision of earlier views
    log_odds: float  # in the last belief that has both classes
    until: int  # row of that belief; -1: before the first one
    last_nats: float  # of the next keyframe, in which one class was pruned; NaN: it was not weighed there

    @property
    def is_pruned(self) -> bool:
        """Whether one of the classes is missing from the last belief."""
        return self.until < len(self.views) - 1

    @property
    def was_weighed(self) -> bool:
        """Whether both classes were still weighed in the keyframe in which one was pruned."""
        return bool(np.isfinite(self.last_nats))

    @property
    def gone(self) -> float:
        """Log odds at which one of the classes was pruned; NaN: both are in the last belief."""
        return self.log_odds + float(np.nan_to_num(self.last_nats)) if self.is_pruned else float("nan")

    @property
    def total(self) -> float:
        """Sum of the rows."""
        return self.prior + float(np.nansum(self.views)) + self.revised


@dataclass(frozen=True, kw_only=True)
class ClassLedger:
    """Class evidence along one history; K keyframes, C classes."""

    object_id: int
    steps: tuple[LiveHistory | None, ...]  # (K,) a hypothesis with this history after each keyframe; None: not yet
    log_weight: float  # of this history in the last belief
    log_prior: Array  # (C,)
    log_mass: Array  # (K, C) log M_k; differences between classes are log odds
    evidence: Array  # (K, C) log M'_k - log M_k-1; NaN once a class has no mass
    rest: Array  # (K, C) log M_k - log M'_k
    is_view: Flags  # (K,) whether the keyframe observes the object
    alone: Array  # (K, C) log p(z | c) of single views at the hypothesis's poses; NaN elsewhere

    @property
    def log_posterior(self) -> Array:
        """(C,) log class probabilities after the last keyframe, given this history."""
        last: Array = self.log_mass[-1]
        return last - log_sum_exp(last) if len(last) else last

    def last_with(self, cls: int) -> int:
        """Last keyframe after which a class has mass; -1: only before the first one."""
        there = np.flatnonzero(np.isfinite(self.log_mass[:, cls]))
        return int(there[-1]) if len(there) else -1

    def pair(self, one: int, other: int) -> PairLedger:
        """Ledger of class ``one`` against class ``other``, up to the last belief that has both."""
        until = min(self.last_with(one), self.last_with(other))
        known = np.arange(len(self.log_mass)) <= until
        with np.errstate(invalid="ignore"):
            nats = self.evidence[:, one] - self.evidence[:, other]
            rest = (self.rest[:, one] - self.rest[:, other])[known].sum()
        prior = float(self.log_prior[one] - self.log_prior[other])
        return PairLedger(
            views=np.where(known & self.is_view, nats, np.nan),
            prior=prior,
            revised=float(rest + nats[known & ~self.is_view].sum()),
            log_odds=prior if until < 0 else float(self.log_mass[until, one] - self.log_mass[until, other]),
            until=until,
            last_nats=float(nats[until + 1]) if until + 1 < len(nats) and np.isfinite(nats[until + 1]) else np.nan,
        )


def histories(run: ReplayedRun) -> list[tuple[int, ...]]:
    """Hypothesis ids of the last belief grouped by association history, heaviest first."""
    groups: dict[int, list[int]] = {}
    last = run.keyframes[-1].live
    for number, own in last.items():
        groups.setdefault(own.history, []).append(number)
    return [tuple(numbers) for numbers in sorted(groups.values(), key=lambda numbers: -_log_weight(last, numbers))]


def _log_weight(live: dict[int, LiveHistory], numbers: Sequence[int]) -> float:
    return float(np.logaddexp.reduce([live[n].log_weight for n in numbers]))


def class_ledger(run: ReplayedRun, object_id: int, member_ids: tuple[int, ...]) -> ClassLedger:
    """Class ledger of one object along the history shared by ``member_ids`` of the last belief."""
    path = run.path(member_ids[0])
    ratios = _log_ratios(path, object_id)
    prior = run.log_class_prior[object_id] if ratios is None else run.log_class_prior[object_id] + ratios
    is_replayed = member_ids[0] in run.revised
    mass, evidence, rest, alone = (np.full((len(path), len(prior)), np.nan) for _ in range(4))
    is_view = np.zeros(len(path), dtype=bool)
    before: Array = prior
    parents = frozenset(run.root_ids)
    for k, own in enumerate(path):
        if own is None:  # nothing is known of earlier keyframes
            mass[k], evidence[k], rest[k] = before, 0.0, 0.0
            continue
        record, live = own.objects[object_id], {} if is_replayed else run.keyframes[k].live
        members = {n: other for n, other in live.items() if other.history == own.history}
        if ratios is not None and record.log_likelihood is None:  # the object does not exist yet
            mass[k], evidence[k], rest[k], parents = before, 0.0, 0.0, frozenset(members)
            continue
        same = list(members.values()) or [own]
        is_view[k] = any(run.on_map(n) == object_id for n in own.association)
        mass[k] = log_sum_exp(np.array([o.log_weight + o.objects[object_id].log_class for o in same]), axis=0)
        if own.is_revised:
            weighed = before
        elif is_view[k] and record.newest is not None:
            weighed = before + record.newest
        else:
            weighed = mass[k] if is_replayed else _weighed(run, k, object_id, parents, own)
        with np.errstate(invalid="ignore"):
            evidence[k], rest[k] = weighed - before, mass[k] - weighed
        if is_view[k] and not own.is_revised:
            alone[k] = _alone(path[k - 1] if k else None, own, object_id)
        before, parents = mass[k], frozenset(members)
    return ClassLedger(
        object_id=object_id,
        steps=tuple(path),
        log_weight=_log_weight(run.keyframes[-1].live, member_ids),
        log_prior=prior,
        log_mass=mass,
        evidence=evidence,
        rest=rest,
        is_view=is_view,
        alone=alone,
    )


def _weighed(run: ReplayedRun, k: int, object_id: int, parents: frozenset[int], own: LiveHistory) -> Array:
    """(C,) log mass of all continuations with one association, including those pruned in that keyframe."""
    keyframe, logs = run.keyframes[k], list[Array]()
    candidates = keyframe.candidates
    same = (candidates.associations == np.array(own.association, dtype=int)).all(axis=1)
    for row in np.flatnonzero(same & np.isin(candidates.parent_ids, list(parents))).tolist():
        log_class = _log_class(run, k, row, object_id)
        if log_class is not None:
            logs.append(float(candidates.log_weights[row]) + log_class)
    return log_sum_exp(np.array(logs), axis=0)


def _log_class(run: ReplayedRun, k: int, row: int, object_id: int) -> Array | None:
    """(C,) log class probabilities in a candidate; None where it was pruned and its component is unavailable."""
    keyframe = run.keyframes[k]
    number = int(keyframe.candidates.ids[row])
    if number in keyframe.live:
        return keyframe.live[number].objects[object_id].log_class
    if not enumerates_classes(run.problem):
        return None
    associated = keyframe.candidates.associations[row].tolist()
    named = [
        int(cls)
        for other, cls in zip(associated, keyframe.candidates.classes[row], strict=True)
        if run.on_map(other) == object_id and cls >= 0
    ]
    if named:
        return np.where(np.arange(len(run.log_class_prior[object_id])) == named[0], 0.0, -np.inf)
    return _parent(run, keyframe, k, row, object_id)


def _parent(run: ReplayedRun, keyframe: ReplayedKeyframe, k: int, row: int, object_id: int) -> Array:
    """(C,) log class probabilities in the parent of a candidate."""
    if k == 0:
        return run.log_class_prior[object_id]
    return run.keyframes[k - 1].live[int(keyframe.candidates.parent_ids[row])].objects[object_id].log_class


def _log_ratios(path: Sequence[LiveHistory | None], object_id: int) -> Array | None:
    """(C,) log ratios of the object's class prior when it was added to the base prior; None: never different."""
    every = (own.objects[object_id].log_ratios for own in path if own is not None)
    return next((ratios for ratios in every if ratios is not None), None)


def _alone(parent: LiveHistory | None, own: LiveHistory, object_id: int) -> Array:
    """(C,) log likelihood gained by the hypothesis's record in the keyframe; NaN where it has no record."""
    record = own.objects[object_id]
    if record.newest is not None:
        return record.newest
    if record.log_likelihood is None:
        return np.full(len(record.log_class), np.nan)
    before = None if parent is None else parent.objects[object_id].log_likelihood
    if before is None:
        return record.log_likelihood if record.log_ratios is None else record.log_likelihood - record.log_ratios
    return record.log_likelihood - before
