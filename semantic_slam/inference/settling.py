"""Smoothers that grow together: what Python has to evaluate for them is evaluated for all at once."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import gtsam
import numpy as np
from numpy.typing import NDArray

from semantic_slam.inference.reoptimisation import changed, reoptimised
from semantic_slam.inference.semantic_factors import Named, Places
from semantic_slam.inference.smoother import LostComponentError, Smoother, first_line

Array = NDArray[np.float64]
Settled = Smoother | LostComponentError

MAX_UPDATES = 8
UNDAMPED = 2
"""Updates after which descriptors go half-way only: Gauss-Newton through a decoder may swing about its optimum."""


@dataclass(frozen=True)
class Extension:
    """What a keyframe adds to a smoother: factors, new variables, and semantic measurements.

    ``start``: states (d,) of variables that the semantic measurements concern, and where they are made. The estimate
    may have ``jumped`` there; with descriptors, ``calm`` are states from which an optimisation may end better.
    """

    graph: gtsam.NonlinearFactorGraph
    values: gtsam.Values
    named: Sequence[Named]
    start: Mapping[int, Array]
    jumped: bool = False
    calm: Mapping[int, Array] = field(default_factory=dict)


def extend_all(smoothers: Sequence[Smoother], extensions: Sequence[Extension]) -> list[Settled]:
    """Forks with their extensions, updated until no state is so far from where it is linearised that it matters.

    Where the estimate jumped, or does not settle, the whole is optimised. An error stands for a smoother whose system
    is indeterminate.
    """
    if not smoothers:
        return []
    grown: list[Settled] = [LostComponentError("")] * len(smoothers)
    jumped = [row for row, extension in enumerate(extensions) if extension.jumped]
    for row in jumped:
        grown[row] = _attempt(_jumped, smoothers[row], extensions[row])
    calm = [row for row, extension in enumerate(extensions) if not extension.jumped]
    forks = _forked([smoothers[row] for row in calm], [extensions[row] for row in calm])
    settled = _settled(forks, [extensions[row] for row in calm])
    for row, smoother in zip(calm, settled, strict=True):
        grown[row] = smoother
    return grown


def extend(smoother: Smoother, extension: Extension) -> Smoother:
    """One of them. Raises LostComponentError."""
    grown = extend_all([smoother], [extension])[0]
    if isinstance(grown, LostComponentError):
        raise grown
    return grown


def _jumped(smoother: Smoother, extension: Extension) -> Smoother:
    """Optimised from where the estimate jumped to; what the extension does not name begins where it was."""
    origin = smoother.isam.calculateEstimate()
    origin.insert(extension.values)
    kept = smoother.kept()
    kept.push_back(extension.graph)
    return reoptimised(smoother, kept, [*smoother.made.named, *extension.named], _starts(smoother, origin, extension))


def _forked(smoothers: Sequence[Smoother], extensions: Sequence[Extension]) -> list[Settled]:
    """After one update."""
    named, places = [own.named for own in extensions], [Places.of(own.named, own.start) for own in extensions]
    made = smoothers[0].semantics.make(named, places) if smoothers else []

    def fork(row: int) -> Smoother:
        own = extensions[row]
        isam = gtsam.ISAM2(smoothers[row].isam)
        return smoothers[row].updated(isam, own.graph, own.values, own.named, made[row], places[row])

    return [_attempt(fork, row) for row in range(len(smoothers))]


def _settled(forks: list[Settled], extensions: Sequence[Extension]) -> list[Settled]:
    """Updated on; where states were linearised anew, so are the semantic factors of the objects that were observed.

    Exact factors of descriptors that have been seen so well that new ones are linear become linear.
    """
    exact = {
        row: fork.exact_rows({item.descriptor_key for item in extensions[row].named if not item.exact})
        for row, fork in enumerate(forks)
        if isinstance(fork, Smoother)
    }
    for number in range(MAX_UPDATES):
        pending = {row: fork for row in exact if isinstance(fork := forks[row], Smoother)}
        pending = {row: fork for row, fork in pending.items() if exact[row] or fork.is_latent or not fork.rests()}
        stale = _stale(list(pending.values()), [extensions[row].start.keys() for row in pending])
        rows = {row: [*own, *exact[row]] for row, own in zip(pending, stale, strict=True)}
        pending = {row: fork for row, fork in pending.items() if rows[row] or not fork.rests()}
        if not pending:
            return forks
        renewed = _renewed(list(pending.values()), [rows[row] for row in pending], damped=number >= UNDAMPED)
        exact = {row: [] for row in pending}
        for row, fork in zip(pending, renewed, strict=True):
            forks[row] = fork
    for row in exact:
        fork = forks[row]
        forks[row] = _attempt(_restless, fork, extensions[row]) if isinstance(fork, Smoother) else fork
    return forks


def _restless(fork: Smoother, extension: Extension) -> Smoother:
    starts = _starts(fork, fork.isam.calculateEstimate(), extension)
    return reoptimised(fork, fork.kept(), fork.made.named, starts)


def _starts(smoother: Smoother, origin: gtsam.Values, extension: Extension) -> list[gtsam.Values]:
    """Of an optimisation: where the extension is, and where it is calm; what it does not name begins at ``origin``."""
    states = [extension.start, extension.calm] if extension.calm else [extension.start]
    return [changed(smoother.manifold, origin, own) for own in states]


def _stale(smoothers: Sequence[Smoother], objects: Sequence[Collection[int]]) -> list[list[int]]:
    """Which linear factors of these objects are no longer where they were made; of all where the map floats."""
    stale, floats = _moved(smoothers, [own.linear_rows(keys) for own, keys in zip(smoothers, objects, strict=True)])
    floating = [row for row, afloat in enumerate(floats) if afloat]
    afloat = [smoothers[row] for row in floating]
    for row, own in zip(floating, _moved(afloat, [one.linear_rows() for one in afloat])[0], strict=True):
        stale[row] = own
    return stale


def _moved(smoothers: Sequence[Smoother], rows: Sequence[list[int]]) -> tuple[list[list[int]], list[bool]]:
    """Of the given linear factors those that are to be made anew, and whether the map floats."""
    some = [number for number, own in enumerate(rows) if own]
    stale: list[list[int]] = [[] for _ in rows]
    floats = [False] * len(rows)
    if not some:
        return stale, floats
    before = Places.joined([smoothers[n].made.places.take(rows[n]) for n in some])
    now = Places.joined([smoothers[n].places(rows[n]) for n in some])
    moved, floating = smoothers[0].semantics.moved(before, now)
    ends = np.cumsum([len(rows[n]) for n in some])[:-1]
    for n, own, afloat in zip(some, np.split(moved, ends), np.split(floating, ends), strict=True):
        stale[n] = [row for row, is_stale in zip(rows[n], own, strict=True) if is_stale]
        floats[n] = bool(afloat.any())
    return stale, floats


def _renewed(smoothers: Sequence[Smoother], rows: Sequence[list[int]], *, damped: bool) -> list[Settled]:
    """With these factors made anew, all linear, at the estimates; descriptors half-way there where ``damped``."""
    semantics = smoothers[0].semantics
    places = [one.places(own) for one, own in zip(smoothers, rows, strict=True)]
    if damped:
        places = [_halfway(one.made.places.take(own), at) for one, own, at in zip(smoothers, rows, places, strict=True)]
    made = semantics.make([one.linear(own) for one, own in zip(smoothers, rows, strict=True)], places)
    return [_attempt(one.renewed, *parts) for one, *parts in zip(smoothers, rows, made, places, strict=True)]


def _halfway(before: Places, now: Places) -> Places:
    return replace(now, descriptors=0.5 * (before.descriptors + now.descriptors))


def _attempt(make: Callable[..., Smoother], *arguments: object) -> Settled:
    try:
        return make(*arguments)
    except RuntimeError as fault:
        return LostComponentError(f"an update failed ({first_line(fault)})")
