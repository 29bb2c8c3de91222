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
from semantic_slam.inference.revision.pairs import Pair, apart, relative_positions
from semantic_slam.inference.smoothing.errors import LostComponentError


@dataclass(frozen=True)
class Joined:
    """Pairs of objects that may be one each."""

    pairs: tuple[Pair, ...]
    gains: Array  # (T,) rough log gain of the history with them joined, of each keyframe


def joined(view: Hindsight, pairs: Sequence[Pair], least: float) -> list[Joined]:
    """The ``pairs`` that gain more than ``least`` [nats] joined, and all of them at once if there are several.

    Each object is in one pair at most, the one that gains most: something vague may be one with whatever is near.
    """
    known = set(view.ids.tolist())
    pairs = [pair for pair in pairs if known.issuperset(pair)]
    try:
        log_places = _log_at_nothing(*relative_positions(view.component, pairs)) if pairs else np.zeros(0)
    except LostComponentError:
        return []
    gains = {pair: _gains(view, pair, own) for pair, own in zip(pairs, log_places.tolist(), strict=True)}
    likely = sorted((pair for pair in pairs if gains[pair].sum() > least), key=lambda pair: -gains[pair].sum())
    chosen = apart(likely)
    groups = [*([chosen] if len(chosen) > 1 else []), *([pair] for pair in chosen)]
    return [Joined(tuple(group), np.sum([gains[pair] for pair in group], axis=0)) for group in groups]


def _log_at_nothing(offsets: Array, spreads: Array) -> Array:
    """(n,) log densities at nothing of relative positions (n, p), whose covariances are (n, p, p)."""
    squared = np.vecdot(offsets, np.linalg.solve(spreads, offsets[..., None])[..., 0])
    return np.asarray(-0.5 * (squared + np.linalg.slogdet(2.0 * np.pi * spreads)[1]))


def _gains(view: Hindsight, pair: Pair, log_place: float) -> Array:
    """(T,) gains of each keyframe; those by places and words among the keyframes where the younger was detected."""
    older, younger = (int(np.flatnonzero(view.ids == number)[0]) for number in pair)
    times, later = view.detected_at(older), view.detected_at(younger)
    gains = _log_misses(view, older, times | later)
    gains -= _log_misses(view, older, times) + _log_misses(view, younger, later)
    gains[view.first_seen[younger]] -= _log_of_birth(view)
    gains[later] += (log_place + view.log_of_one(*pair)) / later.sum()
    return gains


def _log_of_birth(view: Hindsight) -> float:
    """Log intensity of first detections, relative to the probability that an object in view is detected."""
    rates = view.component.objects.rates
    return float(np.log(rates.average(rates.probability * rates.birth_density)) - np.log(view.detected))


def _log_misses(view: Hindsight, row: int, times: Flags) -> Array:
    """(T,) log probability of the misses of an object at its place, if it is detected at ``times`` (T,)."""
    return np.where(view.in_view[row] & ~times & np.logical_or.accumulate(times), view.log_missed, 0.0)
