"""Lineages as a table of their distinct steps: what many hypotheses share is written once, as numbers."""

from collections.abc import Sequence
from itertools import accumulate, pairwise
from typing import Any, Self

import numpy as np

from semantic_slam.geometry.arrays import Index
from semantic_slam.inference.states.lineage import Lineage, LineageStep


class LineageTable:
    """The K distinct steps of some lineages, in the order in which they were added."""

    def __init__(self, steps: Sequence[LineageStep] = ()) -> None:
        self.steps = list(steps)
        self._rows: dict[int, int] = {}  # identity of a step -> its row
        self._known: dict[int, tuple[Lineage, Index]] = {}  # identity of a lineage -> it, and its rows

    def rows(self, lineage: Lineage) -> Index:
        """(n,) rows of a lineage's steps, which are added where they are new."""
        known = self._known.get(id(lineage))
        if known is None:
            known = lineage, np.array([self._row(step) for step in lineage], dtype=np.int32)
            self._known[id(lineage)] = known
        return known[1]

    def _row(self, step: LineageStep) -> int:
        row = self._rows.setdefault(id(step), len(self.steps))
        if row == len(self.steps):
            self.steps.append(step)
        return row

    def columns(self) -> dict[str, Any]:
        """The steps as arrays: sizes (K,) and numbers of both tuples, modes (K,); and the changes by row, if any."""
        return {
            "sizes": np.array(
                [[len(own.association), len(own.class_assignment)] for own in self.steps], dtype=np.int32
            ).reshape(-1, 2),
            "associations": np.array([n for own in self.steps for n in own.association], dtype=np.int64),
            "classes": np.array([n for own in self.steps for n in own.class_assignment], dtype=np.int32),
            "modes": np.array([own.mode for own in self.steps], dtype=np.int64),
            "changes": {row: own.changes for row, own in enumerate(self.steps) if own.changes},
        }

    @classmethod
    def of(cls, columns: dict[str, Any]) -> Self:
        """The table of :meth:`columns`. Raises LookupError or TypeError for other columns."""
        associations = _parts(columns["associations"], columns["sizes"][:, 0])
        classes = _parts(columns["classes"], columns["sizes"][:, 1])
        rows = enumerate(zip(associations, classes, columns["modes"].tolist(), strict=True))
        return cls([LineageStep.of(*own, columns["changes"].get(row, ())) for row, own in rows])

    def lineage(self, rows: Index) -> Lineage:
        """The lineage with these rows."""
        return tuple(self.steps[row] for row in rows.tolist())


def _parts(numbers: Index, sizes: Index) -> list[list[int]]:
    every = numbers.tolist()
    return [every[begin:end] for begin, end in pairwise(accumulate(sizes.tolist(), initial=0))]
