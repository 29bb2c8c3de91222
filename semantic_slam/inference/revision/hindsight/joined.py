"""Duplicates: two objects of one thing, which was not recognised when it was seen from another side or after a drift.

Joined, the thing is born once, is missed where neither of the two was detected, and both have one place and one class.
What that gains follows from the history in which they are apart: the ratio of the evidence is the density of their
relative position at nothing, over the intensity of births there. Curvature of rays and priors of ranges are left out.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags
from semantic_slam.inference.revision.hindsight.hindsight import Hindsight
from semantic_slam.inference.revision.pairs import Pair, apart, merged, relative_positions
from semantic_slam.inference.smoothing.errors import LostComponentError
from semantic_slam.inference.states.lineage import Lineage


@dataclass(frozen=True)
class Joined:
    """Pairs of objects that may be one each."""

    pairs: Sequence[Pair]
    gains: Array  # (T,) rough log gain of the history with them joined, of each keyframe

    @property
    def gain(self) -> float:
        """Rough log gain of the whole history."""
        return float(self.gains.sum())

    def history(self, view: Hindsight) -> Lineage:
        """The history with them joined."""
        return merged(view.lineage, self.pairs)


def joined(view: Hindsight, pairs: Sequence[Pair], least: float) -> list[Joined]:
    """The ``pairs`` that gain more than ``least`` [nats] joined, largest gain first; before them all at once."""
    known = set(view.ids.tolist())
    pairs = [pair for pair in pairs if known.issuperset(pair)]
    try:
        log_places = log_at_nothing(*relative_positions(view.component, pairs)) if pairs else np.zeros(0)
    except LostComponentError:
        return []
    every = [Joined([pair], _gains(view, pair, own)) for pair, own in zip(pairs, log_places.tolist(), strict=True)]
    found = sorted((own for own in every if own.gain > least), key=lambda own: -own.gain)
    together = set(apart([own.pairs[0] for own in found]))
    chosen = [own for own in found if own.pairs[0] in together]
    if len(chosen) > 1:
        found.insert(0, Joined([own.pairs[0] for own in chosen], np.sum([own.gains for own in chosen], axis=0)))
    return found


def log_at_nothing(offsets: Array, spreads: Array) -> Array:
    """(n,) log densities at nothing of relative positions (n, p), whose covariances are (n, p, p)."""
    squared = np.vecdot(offsets, np.linalg.solve(spreads, offsets[..., None])[..., 0])
    return np.asarray(-0.5 * (squared + np.linalg.slogdet(2.0 * np.pi * spreads)[1]))


def _gains(view: Hindsight, pair: Pair, log_place: float) -> Array:
    """(T,) gains of each keyframe; those by places and words among the keyframes where the younger was detected."""
    older, younger = (int(np.flatnonzero(view.ids == number)[0]) for number in pair)
    times, later = view.detected_at(older), view.detected_at(younger)
    gains = log_misses(view, older, times | later) - log_misses(view, older, times) - log_misses(view, younger, later)
    gains[view.first_seen[younger]] -= log_of_birth(view)
    gains[later] += (log_place + view.log_of_one(*pair)) / later.sum()
    return gains


def log_of_birth(view: Hindsight) -> float:
    """Log intensity of first detections, relative to the probability that an object in view is detected."""
    rates = view.component.objects.rates
    return float(np.log(rates.average(rates.probability * rates.birth_density)) - np.log(view.detected))


def log_misses(view: Hindsight, row: int, times: Flags) -> Array:
    """(T,) log probability of the misses of an object at its place, if it is detected at ``times`` (T,)."""
    return np.where(view.in_view[row] & ~times & np.logical_or.accumulate(times), view.log_missed, 0.0)
