"""Detections grouped by the object before and the object after a reassociation: atoms, the parts that objects swap.

A revised history follows from its changes alone, so that repeating them gives an identical result.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from semantic_slam.geometry.arrays import Index
from semantic_slam.inference.smoothing.reassociation import Sighted
from semantic_slam.inference.states.lineage import Reassigned

Born = Callable[[int, int], int]
"""Id of the object that a detection (keyframe, number) would start."""


@dataclass(frozen=True)
class Atoms:
    """n detections in atoms; each atom belongs to one object before the reassociation, and to one after."""

    sighted: Sighted  # n detections with their objects before
    atoms: Index  # (n,) atom ids: the object's for its oldest part, else the id that the part would start
    objects: Index  # (n,) object ids after

    @classmethod
    def of(cls, sighted: Sighted, changes: Sequence[Reassigned], born: Born) -> Self:
        """The atoms into which ``changes`` divide the objects."""
        objects = sighted.objects.copy()
        row_of = {pair: row for row, pair in enumerate(zip(sighted.keyframes, sighted.numbers, strict=True))}
        for keyframe, number, object_id, _ in changes:
            objects[row_of[keyframe, number]] = object_id
        return cls(sighted, _parted(sighted, objects, born), objects)

    @property
    def sources(self) -> dict[int, int]:
        """Atom id -> id of the object that it belonged to before."""
        return dict(zip(self.atoms.tolist(), self.sighted.objects.tolist(), strict=True))

    @property
    def joins(self) -> list[tuple[int, int]]:
        """Pairs of atoms that become one object: the oldest atom of the object, and each of the others."""
        found = []
        for number in np.unique(self.objects[self.objects != self.atoms]).tolist():
            parts = _in_order(self.atoms[self.objects == number])
            found += [(parts[0], part) for part in parts[1:]]
        return found

    def changes(self) -> tuple[Reassigned, ...]:
        """The detections whose object changes, with their objects after and before."""
        rows = np.flatnonzero(self.objects != self.sighted.objects)
        columns = self.sighted.keyframes, self.sighted.numbers, self.objects, self.sighted.objects
        return tuple(sorted(zip(*(column[rows].tolist() for column in columns), strict=True)))


def _parted(sighted: Sighted, objects: Index, born: Born) -> Index:
    """(n,) atom ids."""
    atoms = sighted.objects.copy()
    for number in np.unique(sighted.objects[objects != sighted.objects]).tolist():
        rows = np.flatnonzero(sighted.objects == number)
        for name in _in_order(objects[rows])[1:]:
            part = rows[objects[rows] == name]
            atoms[part] = born(int(sighted.keyframes[part[0]]), int(sighted.numbers[part[0]]))
    return atoms


def _in_order(numbers: Index) -> list[int]:
    """Distinct numbers in order of first appearance."""
    return list(dict.fromkeys(numbers.tolist()))
