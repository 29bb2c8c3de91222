"""Smoothers that grow together: what Python has to evaluate for them is evaluated for all at once."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

import gtsam
import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.smoothing.errors import LostComponentError, lost_where_indeterminate
from semantic_slam.inference.smoothing.factor_table import AddedFactors, RelinearisedFactors
from semantic_slam.inference.smoothing.reoptimisation import changed, reoptimised
from semantic_slam.inference.smoothing.semantic_factors import NO_POINTS, LinearisationPoints, SemanticFactor
from semantic_slam.inference.smoothing.smoother import CONVERGED, Smoother

Outcome = Smoother | LostComponentError
T = TypeVar("T")

MAX_UPDATES = 8


@dataclass(frozen=True, kw_only=True)
class Extension:
    """What a keyframe adds to a smoother: factors, new variables, and semantic measurements.

    ``start``: states (s,) of variables that the semantic measurements concern, and where they are made. The estimate
    may have ``jumped`` there; with descriptors, ``other_start`` are states from which an optimisation may end better.
    """

    graph: gtsam.NonlinearFactorGraph
    values: gtsam.Values
    measurements: Sequence[SemanticFactor]
    start: Mapping[int, Array]
    jumped: bool = False
    other_start: Mapping[int, Array] = field(default_factory=dict)
    bounds: Mapping[int, float] = field(default_factory=dict)  # key -> metres from where it may be linearised


@dataclass(frozen=True, kw_only=True)
class _Fork:
    """A smoother on its way to convergence."""

    extension: Extension
    smoother: Smoother
    converged: bool
    exact: Sequence[int] = ()  # semantic measurements whose exact factors are to become linear
    made_at: Mapping[int, Array] = field(default_factory=dict)  # descriptors of the factors made in the round before


@dataclass(frozen=True)
class _Remains:
    """What an update that fails leaves of the smoother that it has consumed."""

    isam: gtsam.ISAM2
    num_factors: int  # before the update; it has added others after them

    @classmethod
    def of(cls, smoother: Smoother) -> "_Remains":
        """Taken before the update."""
        return cls(smoother.isam, int(smoother.isam.getFactorsUnsafe().size()))

    def kept(self, smoother: Smoother) -> gtsam.NonlinearFactorGraph:
        """All factors that were there before but the semantic ones."""
        return smoother.factor_table.without(self.isam.getFactorsUnsafe(), self.num_factors)


@dataclass(frozen=True)
class _Stale:
    """Linear factors of one smoother that are no longer where they were made."""

    rows: list[int] = field(default_factory=list)
    floats: bool = False  # because the map floats
    urgent: bool = False  # so far that the next keyframe's update is too late


def update_all(
    smoothers: Sequence[Smoother], extensions: Sequence[Extension], consumed: Collection[int] = ()
) -> list[Outcome]:
    """Forks with their extensions, updated until no state is so far from where it is linearised that it matters.

    Where the estimate jumped, does not converge, or is too poorly conditioned for an update, the whole is optimised. An
    error stands for a smoother whose system is indeterminate. The rows ``consumed``, which nobody needs again, are not
    forked. (Parents at which a window begins are needed; but their children have jumped.)
    """
    steady = {row: smoothers[row] for row, extension in enumerate(extensions) if not extension.jumped}
    remains = {row: _Remains.of(steady[row]) for row in consumed if row in steady}
    mine = {row: smoother if row in remains else smoother.fork() for row, smoother in steady.items()}
    outcomes = _iterated(_begun(mine, {row: extensions[row] for row in steady}))
    for row, extension in enumerate(extensions):
        if extension.jumped or isinstance(outcomes[row], LostComponentError):
            outcomes[row] = _attempt(_jumped, smoothers[row], extension, remains.get(row))
    return [outcomes[row] for row in range(len(smoothers))]


def _jumped(smoother: Smoother, extension: Extension, remains: _Remains | None) -> Smoother:
    """Optimised from where the estimate jumped to; what the extension does not name begins where it was.

    Of a smoother that an update has consumed in vain there are its ``remains``.
    """
    if remains is None:
        origin, kept = smoother.isam.calculateEstimate(), smoother.kept()
    else:
        origin, kept = gtsam.Values(remains.isam.getLinearizationPoint()), remains.kept(smoother)
    origin.insert_or_assign(extension.values)
    kept.push_back(extension.graph)
    return reoptimised(
        smoother,
        kept,
        [*smoother.factor_table.measurements, *extension.measurements],
        _starts(smoother, origin, extension),
    )


def _begun(
    smoothers: Mapping[int, Smoother], extensions: Mapping[int, Extension]
) -> dict[int, _Fork | LostComponentError]:
    """Forks after one update, which consumes the smoothers and renews what has moved since it was made."""
    if not smoothers:
        return {}
    before, additions = list(smoothers.values()), list(extensions.values())
    semantics, points = before[0].semantics, [LinearisationPoints.of(one.measurements, one.start) for one in additions]
    stale = [each.rows for each in _stale(before, [one.start.keys() for one in additions])]
    now = [one.points(rows) if rows else NO_POINTS for one, rows in zip(before, stale, strict=True)]
    again = semantics.make([one.factor_table.linear(rows) for one, rows in zip(before, stale, strict=True)], now)
    made = semantics.make([one.measurements for one in additions], points)

    def begin(smoother: Smoother, extension: Extension, added: AddedFactors, renewal: RelinearisedFactors) -> _Fork:
        updated = smoother.updated(extension.graph, extension.values, added, renewal)
        certain = {item.descriptor_key for item in extension.measurements if not item.exact}
        return _Fork(
            extension=extension,
            smoother=updated,
            converged=updated.converged(),
            exact=updated.factor_table.exact_rows(certain),
        )

    added = [
        AddedFactors(one.measurements, factors, at) for one, factors, at in zip(additions, made, points, strict=True)
    ]
    renewals = [RelinearisedFactors(*parts) for parts in zip(stale, again, now, strict=True)]
    rows = zip(smoothers, before, additions, added, renewals, strict=True)
    return {row: _attempt(begin, *parts) for row, *parts in rows}


def _iterated(forks: Mapping[int, _Fork | LostComponentError]) -> dict[int, Outcome]:
    """Updated on; the semantic factors of the objects that were observed are made anew where their views changed.

    Exact factors of descriptors that have been seen so well that new ones are linear become linear.
    """
    outcomes: dict[int, Outcome] = {row: fork for row, fork in forks.items() if isinstance(fork, LostComponentError)}
    pending = {row: fork for row, fork in forks.items() if isinstance(fork, _Fork)}
    for number in range(MAX_UPDATES + 1):
        rows = {row: [*stale, *pending[row].exact] for row, stale in _to_renew(pending).items()}
        done = [row for row, fork in pending.items() if fork.converged and not rows[row]]
        outcomes |= {row: _settled(pending.pop(row)) for row in done}
        if not pending or number == MAX_UPDATES:
            break
        renewed = dict(zip(pending, _renewed(list(pending.values()), [rows[row] for row in pending]), strict=True))
        outcomes |= {row: fork for row, fork in renewed.items() if isinstance(fork, LostComponentError)}
        pending = {row: fork for row, fork in renewed.items() if isinstance(fork, _Fork)}
    # Poses at rest, and descriptors on their way: the next keyframe goes on.
    return outcomes | {
        row: _settled(fork) if fork.converged else _attempt(_whole, fork) for row, fork in pending.items()
    }


def _settled(fork: _Fork) -> Outcome:
    """A fork that has converged; optimised as a whole where a bound says that it has not where it matters."""
    bounds = fork.extension.bounds
    if bounds:
        changes = fork.smoother.isam.getDelta()
        if any(np.linalg.norm(changes.at(key)) > bound for key, bound in bounds.items()):
            return _attempt(_whole, fork)
    return fork.smoother


def _whole(fork: _Fork) -> Smoother:
    smoother = fork.smoother
    starts = _starts(smoother, smoother.isam.calculateEstimate(), fork.extension)
    return reoptimised(smoother, smoother.kept(), smoother.factor_table.measurements, starts)


def _starts(smoother: Smoother, origin: gtsam.Values, extension: Extension) -> list[gtsam.Values]:
    """Starts of an optimisation: the extension's states, and its ``other_start``; all others are at ``origin``."""
    states = [extension.start, extension.other_start] if extension.other_start else [extension.start]
    return [changed(smoother.spaces, origin, start) for start in states]


def _to_renew(forks: Mapping[int, _Fork]) -> dict[int, list[int]]:
    """Stale factors of forks that go on; those of a converged fork wait until their object is seen again.

    Unless they are far off, or an update is due anyway. Under classes they wait in any case: their variables are poses.
    """
    going = {
        row: fork for row, fork in forks.items() if fork.smoother.semantics.latent is not None or not fork.converged
    }
    smoothers = [fork.smoother for fork in going.values()]
    stale = _stale(smoothers, [fork.extension.start.keys() for fork in going.values()])
    due = {
        row: moved.rows
        for (row, fork), moved in zip(going.items(), stale, strict=True)
        if moved.urgent or fork.exact or not fork.converged
    }
    return {row: [] for row in forks} | due


def _stale(smoothers: Sequence[Smoother], observed: Sequence[Collection[int]]) -> list[_Stale]:
    """Which linear factors of what was observed are no longer where they were made; of all where the map floats."""
    tables = [own.factor_table for own in smoothers]
    stale = _moved(smoothers, [own.linear_rows(keys) for own, keys in zip(tables, observed, strict=True)])
    floating = [row for row, moved in enumerate(stale) if moved.floats]
    afloat = [smoothers[row] for row in floating]
    for row, moved in zip(floating, _moved(afloat, [each.factor_table.linear_rows() for each in afloat]), strict=True):
        stale[row] = moved
    return stale


def _moved(smoothers: Sequence[Smoother], rows: Sequence[Index]) -> list[_Stale]:
    """Linear factors among ``rows`` whose linearisation points have moved so far that they are to be made anew."""
    some = [number for number, linear in enumerate(rows) if len(linear)]
    stale = [_Stale() for _ in rows]
    if not some:
        return stale
    before = LinearisationPoints.joined([smoothers[n].factor_table.points.take(rows[n]) for n in some])
    now = LinearisationPoints.joined([smoothers[n].points(rows[n]) for n in some])
    change, floating = smoothers[0].semantics.change(before, now)
    ends = np.cumsum([len(rows[n]) for n in some])
    for place in np.unique(np.searchsorted(ends, np.flatnonzero(change > 1.0), side="right")).tolist():
        span, n = slice(ends[place] - len(rows[some[place]]), ends[place]), some[place]
        urgent = bool((change[span] > CONVERGED).any())
        stale[n] = _Stale(rows[n][change[span] > 1.0].tolist(), bool(floating[span].any()), urgent)
    return stale


def _renewed(forks: Sequence[_Fork], rows: Sequence[list[int]]) -> list[_Fork | LostComponentError]:
    """Forks with these factors made anew, all linear, at the estimates; the second time on half-way there.

    Gauss-Newton through a decoder may swing about its optimum.
    """
    semantics = forks[0].smoother.semantics
    measurements = [fork.smoother.factor_table.linear(chosen) for fork, chosen in zip(forks, rows, strict=True)]
    points = [
        _halfway(fork.smoother.points(chosen), fork, what)
        for fork, chosen, what in zip(forks, rows, measurements, strict=True)
    ]
    made = semantics.make(measurements, points)

    def renew(
        fork: _Fork, chosen: list[int], what: list[SemanticFactor], factors: Sequence[Any], at: LinearisationPoints
    ) -> _Fork:
        renewed = fork.smoother.renewed(RelinearisedFactors(chosen, factors, at))
        keys = [item.descriptor_key for item in what if item.descriptor_key is not None]
        made_at = {**fork.made_at, **dict(zip(keys, at.descriptors, strict=False))}
        return _Fork(extension=fork.extension, smoother=renewed, converged=renewed.converged(), made_at=made_at)

    return [_attempt(renew, *parts) for parts in zip(forks, rows, measurements, made, points, strict=True)]


def _halfway(now: LinearisationPoints, fork: _Fork, measurements: Sequence[SemanticFactor]) -> LinearisationPoints:
    """Between the estimates ``now`` and where the descriptors' factors were made in the round before."""
    if not fork.made_at:
        return now
    descriptors = now.descriptors.copy()
    for row, item in enumerate(measurements):
        before = fork.made_at.get(item.descriptor_key) if item.descriptor_key is not None else None
        if before is not None:
            descriptors[row] = 0.5 * (before + descriptors[row])
    return LinearisationPoints.stacked(now.robots, now.objects, descriptors)


def _attempt(make: Callable[..., T], *arguments: object) -> T | LostComponentError:
    """What is made, or why its system is indeterminate."""
    try:
        with lost_where_indeterminate("an update"):
            return make(*arguments)
    except LostComponentError as fault:
        return fault
