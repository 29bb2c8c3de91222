"""Duplicates: two objects of one thing, which was not recognised when it was seen from another side or after a drift.

Joined, the thing is born once, is missed where neither of the two was detected, and both have one place and one class.
What that gains follows from the history in which they are apart: the ratio of the evidence is the density of their
relative position at nothing, over the intensity of births there, which is low where the camera has looked before.
Curvature of rays, priors of ranges, and that one of the two may hide the other are left out.

A drift moves all that was seen after it. So pairs are weighed jointly: where one pair is one object, the others may be
so much likelier to be one, too.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.revision.hindsight.dissolved import gains_of_misses
from semantic_slam.inference.revision.hindsight.hindsight import Hindsight
from semantic_slam.inference.revision.pairs import Pair, relative_positions
from semantic_slam.inference.smoothing.errors import LostComponentError

MOST_PAIRS = 30
"""Pairs that are weighed, nearest first: the work grows with their cube."""


@dataclass(frozen=True)
class Joined:
    """Pairs of objects that may be one each."""

    pairs: tuple[Pair, ...]
    gains: Array  # (T,) rough log gain of the history with them joined, of each keyframe


def joined(view: Hindsight, pairs: Sequence[Pair], least: float) -> list[Joined]:
    """Groups of the ``pairs`` that gain more than ``least`` [nats] joined, largest gain first.

    Of the pairs, nearest first, ``MOST_PAIRS`` are weighed. A group begins with any of them, and goes on with the one
    that gains most given those before, as long as that gains. Each object is in one pair at most: something vague may
    be one with whatever is near.
    """
    known = set(view.ids.tolist())
    pairs = [pair for pair in pairs if known.issuperset(pair)][:MOST_PAIRS]
    if not pairs:
        return []
    others = np.array([_apart_from_place(view, pair) for pair in pairs])  # (n, T)
    try:
        found = _groups(np.array(pairs), *relative_positions(view.component, pairs), others.sum(axis=1))
    except (LostComponentError, np.linalg.LinAlgError):
        return []
    gains = {tuple(sorted(pairs[row] for row in group)): _gains(view, pairs, others, group) for group in found}
    likely = [Joined(group, own) for group, own in gains.items() if own.sum() > least]
    return sorted(likely, key=lambda own: -own.gains.sum())


def _groups(objects: Index, offsets: Array, spreads: Array, others: Array) -> list[dict[int, float]]:
    """For each pair the likeliest group that begins with it."""
    return [likeliest_group(objects, offsets, spreads, others, first) for first in range(len(objects))]


def _gains(view: Hindsight, pairs: Sequence[Pair], others: Array, group: Mapping[int, float]) -> Array:
    """(T,) gains of each keyframe; those by places among the keyframes where the younger one was detected."""
    gains = np.asarray(others[list(group)].sum(axis=0))
    for row, log_place in group.items():
        later = view.detected_at(int(np.flatnonzero(view.ids == pairs[row][1])[0]))
        gains[later] += log_place / later.sum()
    return gains


def likeliest_group(objects: Index, offsets: Array, spreads: Array, others: Array, first: int) -> dict[int, float]:
    """Rows of the pairs of a group, with the log density of each one's relative position given those before.

    ``objects`` (n, 2) of the pairs; ``others`` (n,) gains by all but the relative positions, of which ``offsets``
    (n, p) are the means and ``spreads`` (n, n, p, p) the joint covariances.
    """
    found, may = dict[int, float](), np.arange(len(objects))
    while len(may):
        log_density = _log_at_nothing(offsets[may], spreads[may, may])
        place = int(np.argmax(log_density + others[may])) if found else first
        if found and log_density[place] + others[may[place]] <= 0.0:
            break
        row = int(may[place])
        found[row] = float(log_density[place])
        pull = spreads[:, row] @ np.linalg.inv(spreads[row, row])  # (n, p, p) regression on that pair's position
        offsets = offsets - pull @ offsets[row]
        spreads = spreads - np.einsum("iab,jcb->ijac", pull, spreads[:, row])
        may = may[~np.isin(objects[may], objects[row]).any(axis=1)]
    return found


def _log_at_nothing(offsets: Array, spreads: Array) -> Array:
    """(n,) log densities at nothing of relative positions (n, p) with covariances (n, p, p)."""
    squared = np.vecdot(offsets, np.linalg.solve(spreads, offsets[..., None])[..., 0])
    return np.asarray(-0.5 * (squared + np.linalg.slogdet(2.0 * np.pi * spreads)[1]))


def _apart_from_place(view: Hindsight, pair: Pair) -> Array:
    """(T,) gains by all but the place: one birth and misses of both less, and their words as of one."""
    older, younger = (int(np.flatnonzero(view.ids == number)[0]) for number in pair)
    times, later = view.detected_at(older), view.detected_at(younger)
    gains = gains_of_misses(view, younger, later)
    gains[view.in_view[older] & later & ~times] -= view.log_missed
    gains[view.first_seen[younger]] -= _log_of_birth(view)
    gains[later] += view.log_of_one(*pair) / later.sum()
    return gains


def _log_of_birth(view: Hindsight) -> float:
    """Log intensity of first detections, relative to the probability that an object in view is detected."""
    rates = view.component.objects.rates
    return float(np.log(rates.average(rates.probability * rates.birth_density)) - np.log(view.detected))
