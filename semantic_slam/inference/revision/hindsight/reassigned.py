"""Whole frames reassigned: each detection of a drive goes to the object that it fits best in hindsight.

An object that is none took detections from its neighbours, which in turn took others: where it alone is dissolved, the
others' mistakes stay. Here the detections of each frame are assigned jointly, at most one to each object.
"""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.revision.hindsight.dissolved import Owners, gains_of_misses
from semantic_slam.inference.revision.hindsight.hindsight import Hindsight

STAYS = 2.0
"""Nats in favour of the object that a detection is of so far: weights in hindsight are rough."""
IMPOSSIBLE = -1e6


@dataclass(frozen=True)
class Reassigned:
    """Owners of all detections, and what they promise."""

    gains: Array  # (T,) rough log gain of each keyframe
    owners: Owners

    @property
    def gain(self) -> float:
        """Rough log gain of the whole history."""
        return float(self.gains.sum())


def reassigned(view: Hindsight, without: Collection[int] = ()) -> Reassigned:
    """The likeliest assignment of each frame by the map as now known, ``without`` the objects in these rows."""
    rows = sorted(without)
    gains = np.zeros(len(view.owners))
    for row in rows:
        gains += gains_of_misses(view, row, view.detected_at(row))
    found = []
    for keyframe, before in enumerate(view.owners):
        options, lines = _options(view, keyframe), np.arange(len(before))
        own = _likeliest(options, before, rows)
        births = [row for row in rows if view.first_seen[row] == keyframe]
        options[:, births] = options[:, -1:]
        gains[keyframe] += (options[lines, own] - options[lines, before]).sum()
        found.append(own)
    return Reassigned(gains, found)


def _options(view: Hindsight, keyframe: int) -> Array:
    """(D, N + 1) log weights of a frame's detections relative to a miss of each object; the last column is none."""
    found = view.log_weights[keyframe].copy()
    misses = view.in_view[:, keyframe] & (view.first_seen < keyframe)
    found[:, :-1] -= np.where(misses, view.log_missed, 0.0)
    return found


def _likeliest(options: Array, owners: Index, without: Collection[int]) -> Index:
    """(D,) the joint assignment that weighs most, at most one detection to each object but any number to none."""
    from scipy.optimize import linear_sum_assignment  # deferred: the import takes 0.2 s

    count, none = len(options), options.shape[1] - 1
    weights = options.copy()
    weights[np.arange(count), owners] += STAYS
    weights[:, list(without)] = IMPOSSIBLE
    alone = np.full((count, count), IMPOSSIBLE)
    np.fill_diagonal(alone, weights[:, none])
    _, columns = linear_sum_assignment(np.concatenate([weights[:, :none], alone], axis=1), maximize=True)
    return np.asarray(np.minimum(columns, none))
