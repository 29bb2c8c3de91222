"""Batched iSAM2 updates: what Python has to evaluate for several smoothers is evaluated for all of them at once."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
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

    ``start`` maps keys of the variables of the semantic measurements to states (s,): their linearisation point.
    ``jumped``: these states may be far from the smoother's estimate, or one is the first object seen by a ray alone, so
    that an incremental update will not do. With descriptors, ``other_start`` holds states from which an optimisation
    may end in a better optimum.
    """

    graph: gtsam.NonlinearFactorGraph
    values: gtsam.Values
    measurements: Sequence[SemanticFactor]
    start: Mapping[int, Array]
    jumped: bool = False
    other_start: Mapping[int, Array] = field(default_factory=dict)
    along_rays: bool = False  # some object was seen by a ray alone, now or before


@dataclass(frozen=True, kw_only=True)
class _Fork:
    """A smoother that is being updated until it converges."""

    extension: Extension
    smoother: Smoother
    converged: bool
    exact: Sequence[int] = ()  # rows of semantic measurements whose exact factors become linear
    made_at: Mapping[int, Array] = field(default_factory=dict)  # descriptors at which the last round's factors are


@dataclass(frozen=True)
class _Remains:
    """What a failed update leaves of the smoother that it has consumed."""

    isam: gtsam.ISAM2
    num_factors: int  # before the update, which appends its own after them

    @classmethod
    def of(cls, smoother: Smoother) -> "_Remains":
        """A record taken before the update."""
        return cls(smoother.isam, int(smoother.isam.getFactorsUnsafe().size()))

    def kept(self, smoother: Smoother) -> gtsam.NonlinearFactorGraph:
        """All factors from before the update but the semantic ones."""
        return smoother.factor_table.without(self.isam.getFactorsUnsafe(), self.num_factors)


@dataclass(frozen=True)
class _Stale:
    """Linear factors of one smoother whose linearisation points are out of date."""

    rows: list[int] = field(default_factory=list)
    floats: bool = False  # because the map is not anchored
    urgent: bool = False  # so far off that they cannot wait for the next keyframe


def update_all(
    smoothers: Sequence[Smoother], extensions: Sequence[Extension], consumed: Collection[int] = ()
) -> list[Outcome]:
    """Each smoother updated with its extension until every state is close enough to its linearisation point.

    A full nonlinear optimisation replaces the incremental updates where the estimate jumped, where it does not
    converge, or where an update finds the system too poorly conditioned. A LostComponentError in the result stands for
    a smoother whose system is indeterminate. Smoothers are forked, except the rows ``consumed``, which nobody needs
    afterwards. (A parent at which a window begins is still needed, but then its children have jumped.)
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
    """The smoother optimised from where the estimate jumped to; variables without a new start begin as they were.

    ``remains`` stands in for a smoother that a failed update has consumed.
    """
    if remains is None:
        origin, kept = smoother.isam.calculateEstimate(), smoother.kept()
    else:
        origin, kept = gtsam.Values(remains.isam.getLinearizationPoint()), remains.kept(smoother)
    origin.insert_or_assign(extension.values)
    kept.push_back(extension.graph)
    return reoptimised(
        replace(smoother, along_rays=extension.along_rays),
        kept,
        [*smoother.factor_table.measurements, *extension.measurements],
        _starts(smoother, origin, extension),
    )


def _begun(
    smoothers: Mapping[int, Smoother], extensions: Mapping[int, Extension]
) -> dict[int, _Fork | LostComponentError]:
    """The smoothers after their first update, which consumes them and relinearises stale semantic factors."""
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
    """The forks updated until they converge, ``MAX_UPDATES`` times at most, then optimised as a whole.

    Semantic factors of the objects observed are relinearised where their views changed. Exact factors of descriptors
    that are by now known well enough for new factors to be linear are replaced by linear ones.
    """
    outcomes: dict[int, Outcome] = {row: fork for row, fork in forks.items() if isinstance(fork, LostComponentError)}
    pending = {row: fork for row, fork in forks.items() if isinstance(fork, _Fork)}
    for number in range(MAX_UPDATES + 1):
        rows = {row: [*stale, *pending[row].exact] for row, stale in _to_renew(pending).items()}
        done = [row for row, fork in pending.items() if fork.converged and not rows[row]]
        outcomes |= {row: pending.pop(row).smoother for row in done}
        if not pending or number == MAX_UPDATES:
            break
        renewed = dict(zip(pending, _renewed(list(pending.values()), [rows[row] for row in pending]), strict=True))
        outcomes |= {row: fork for row, fork in renewed.items() if isinstance(fork, LostComponentError)}
        pending = {row: fork for row, fork in renewed.items() if isinstance(fork, _Fork)}
    # Poses have settled and only descriptors still move: the next keyframe continues.
    return outcomes | {
        row: fork.smoother if fork.converged else _attempt(_whole, fork) for row, fork in pending.items()
    }


def _whole(fork: _Fork) -> Smoother:
    smoother = fork.smoother
    starts = _starts(smoother, smoother.isam.calculateEstimate(), fork.extension)
    return reoptimised(smoother, smoother.kept(), smoother.factor_table.measurements, starts)


def _starts(smoother: Smoother, origin: gtsam.Values, extension: Extension) -> list[gtsam.Values]:
    """Starting points of an optimisation: ``origin`` changed to the extension's ``start`` or ``other_start``."""
    states = [extension.start, extension.other_start] if extension.other_start else [extension.start]
    return [changed(smoother.spaces, origin, start) for start in states]


def _to_renew(forks: Mapping[int, _Fork]) -> dict[int, list[int]]:
    """Stale factors to relinearise in forks that continue; a converged fork's wait until their object is seen again.

    They do not wait where they are far off, or where another update is due anyway. Without a latent space those of a
    converged fork always wait: all its variables are poses.
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
    """Linear factors of observed objects with outdated linearisation points; of all where the map is not anchored."""
    tables = [own.factor_table for own in smoothers]
    stale = _moved(smoothers, [own.linear_rows(keys) for own, keys in zip(tables, observed, strict=True)])
    floating = [row for row, moved in enumerate(stale) if moved.floats]
    afloat = [smoothers[row] for row in floating]
    for row, moved in zip(floating, _moved(afloat, [each.factor_table.linear_rows() for each in afloat]), strict=True):
        stale[row] = moved
    return stale


def _moved(smoothers: Sequence[Smoother], rows: Sequence[Index]) -> list[_Stale]:
    """Linear factors among ``rows`` whose linearisation points have moved by more than a threshold."""
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
    """Forks with these factors relinearised at the estimates; from the second time on half-way to them.

    Gauss-Newton through a decoder may oscillate about its optimum.
    """
    semantics = forks[0].smoother.semantics
    measurements = [fork.smoother.factor_table.linear(chosen) for fork, chosen in zip(forks, rows, strict=True)]
    points = [
        _halfway(fork.smoother.points(chosen), fork, what) if chosen else NO_POINTS
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
    """Linearisation points half-way between the estimates ``now`` and the last round's, in the descriptors alone."""
    if not fork.made_at:
        return now
    descriptors = now.descriptors.copy()
    for row, item in enumerate(measurements):
        before = fork.made_at.get(item.descriptor_key) if item.descriptor_key is not None else None
        if before is not None:
            descriptors[row] = 0.5 * (before + descriptors[row])
    return LinearisationPoints.stacked(now.robots, now.objects, descriptors)


def _attempt(make: Callable[..., T], *arguments: object) -> T | LostComponentError:
    """The result of ``make``, or the LostComponentError where its system is indeterminate."""
    try:
        with lost_where_indeterminate("an update"):
            return make(*arguments)
    except LostComponentError as fault:
        return fault
