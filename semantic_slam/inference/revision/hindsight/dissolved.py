"""Spurious objects: their detections were of other objects, and were merged one by one into an object that is none.

Such an object exists for sure after two detections, and costs a miss whenever the camera looks there. Once the misses
outweigh what its detections lose as ones of other objects, the history without it is worth a replay.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.inference.revision.hindsight.hindsight import Hindsight
from semantic_slam.inference.states.lineage import Lineage

Owners = Sequence[Index]
"""T of (D,): which of N objects each detection is of; N: of none of them."""


@dataclass(frozen=True)
class Dissolved:
    """An object that may be spurious."""

    row: int  # row of the object in the history
    gains: Array  # (T,) rough log gain of the history without it, of each keyframe
    owners: Owners  # without it

    @property
    def gain(self) -> float:
        """Rough log gain of the whole history."""
        return float(self.gains.sum())


def dissolved(view: Hindsight) -> list[Dissolved]:
    """Unmapped objects without which their history gains, largest gain first."""
    return [own for own in each_without(view) if own.gain > 0.0]


def each_without(view: Hindsight) -> list[Dissolved]:
    """All unmapped objects, by the gain of their history without each, largest first."""
    rows = np.flatnonzero(~np.isin(view.ids, list(view.problem.map_ids))).tolist()
    found = [without(view, row) for row in rows]
    return sorted(found, key=lambda own: -own.gain)


def without(view: Hindsight, row: int) -> Dissolved:
    """Reassign each detection of an object to the likeliest other not detected in that frame, or to none.

    The gain includes the object's own misses, and one miss of each object that gets a detection.
    """
    owners = view.owners
    found, times = list(owners), view.detected_at(row)
    gains = gains_of_misses(view, row, times)
    for keyframe in np.flatnonzero(times).tolist():
        own = found[keyframe] = owners[keyframe].copy()
        number = int(np.flatnonzero(own == row)[0])
        weights = view.log_weights[keyframe][number]
        may = weights.copy()
        may[own] = -np.inf
        may[-1] = weights[-1]
        best = own[number] = int(np.argmax(may))
        gains[keyframe] += may[best] - weights[row if times[:keyframe].any() else -1]  # the first one was a birth
        if best < len(view.ids) and view.in_view[best, keyframe] and keyframe > view.first_seen[best]:
            gains[keyframe] -= view.log_missed
    return Dissolved(row, gains, found)


def gains_of_misses(view: Hindsight, row: int, times: Flags) -> Array:
    """(T,) log cost of the misses of what is detected at ``times`` (T,), where it would have to be paid.

    Looks before the first detection make the birth then unlikely.
    """
    missed, born = view.in_view[row] & ~times, view.first_seen[row]
    gains = np.where(missed, -view.log_missed, 0.0)
    looks = int(missed[:born].sum())
    gains[:born] = 0.0
    gains[born] = min(-view.log_missed * looks, -view.log_unseen)
    return gains


def lineage_of(view: Hindsight, owners: Owners) -> Lineage:
    """The history in which detections are of ``owners``; objects are named by their first detection."""
    names = {number: number for number in (-1, *view.problem.map_ids)}
    return tuple(
        replace(step, association=tuple(_named(view, keyframe, step.association, owners[keyframe], names)))
        for keyframe, step in enumerate(view.lineage)
    )


def _named(view: Hindsight, keyframe: int, before: Sequence[int], owners: Index, names: dict[int, int]) -> list[int]:
    """(D,) ids of the objects of a frame's detections; new ones are added to ``names``."""
    born, ids = view.registry.first_new_id(keyframe), view.ids.tolist()
    changed = owners != view.owners[keyframe]
    found = []
    for number, (own, is_changed) in enumerate(zip(owners.tolist(), changed.tolist(), strict=True)):
        if is_changed and own == len(ids):
            found.append(born + number)
        else:
            found.append(names.setdefault(ids[own] if is_changed else before[number], born + number))
    return found
