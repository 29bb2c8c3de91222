"""Detections of a history apart by what they were and what they are to be taken for: the parts that objects swap.

All that a revised history is made of follows from what it changes, so that whoever repeats it comes to the same.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from semantic_slam.geometry.arrays import Index
from semantic_slam.inference.smoothing.reassociation import Sighted
from semantic_slam.inference.states.lineage import Reassigned

Born = Callable[[int, int], int]
"""Id of the object that a detection of a keyframe would start."""


@dataclass(frozen=True)
class Atoms:
    """n detections; each atom is of one object before, and of one afterwards."""

    sighted: Sighted  # n, as before
    atoms: Index  # (n,) id of each: that of the object before for its oldest part, else what the part would start
    objects: Index  # (n,) afterwards

    @classmethod
    def of(cls, sighted: Sighted, changes: Sequence[Reassigned], born: Born) -> Self:
        """Parted where ``changes`` ask for it."""
        objects = sighted.objects.copy()
        row_of = {pair: row for row, pair in enumerate(zip(sighted.keyframes, sighted.numbers, strict=True))}
        for keyframe, number, object_id, _ in changes:
            objects[row_of[keyframe, number]] = object_id
        return cls(sighted, _parted(sighted, objects, born), objects)

    @property
    def sources(self) -> dict[int, int]:
        """Atom -> the object that it was of."""
        return dict(zip(self.atoms.tolist(), self.sighted.objects.tolist(), strict=True))

    @property
    def joins(self) -> list[tuple[int, int]]:
        """Pairs of atoms that are of one object afterwards: the oldest of each, and another one."""
        found = []
        for number in np.unique(self.objects[self.objects != self.atoms]).tolist():
            parts = _in_order(self.atoms[self.objects == number])
            found += [(parts[0], part) for part in parts[1:]]
        return found

    def changes(self) -> tuple[Reassigned, ...]:
        """What is of another object than before."""
        rows = np.flatnonzero(self.objects != self.sighted.objects)
        columns = self.sighted.keyframes, self.sighted.numbers, self.objects, self.sighted.objects
        return tuple(sorted(zip(*(column[rows].tolist() for column in columns), strict=True)))


def _parted(sighted: Sighted, objects: Index, born: Born) -> Index:
    """(n,) atoms."""
    atoms = sighted.objects.copy()
    for number in np.unique(sighted.objects[objects != sighted.objects]).tolist():
        rows = np.flatnonzero(sighted.objects == number)
        for name in _in_order(objects[rows])[1:]:
            part = rows[objects[rows] == name]
            atoms[part] = born(int(sighted.keyframes[part[0]]), int(sighted.numbers[part[0]]))
    return atoms


def _in_order(numbers: Index) -> list[int]:
    """Different numbers in the order in which they come first."""
    return list(dict.fromkeys(numbers.tolist()))
