"""The past associations that hypotheses report, and where they differ from what was reported before."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from semantic_slam.geometry.arrays import Flags, Index
from semantic_slam.inference.alternatives.differences import Change
from semantic_slam.inference.hypotheses import Hypothesis
from semantic_slam.inference.states.lineage import Lineage

Place = tuple[int, int]
"""Keyframe and detection."""


@dataclass(frozen=True)
class Told:
    """What H hypotheses report of their past, given R alternatives."""

    lineages: Mapping[int, Lineage]  # H, by hypothesis id, as they are held
    changes: Sequence[tuple[Change, ...]]  # R alternatives
    tells: Flags  # (R, H) whether a hypothesis reports an alternative
    renamed: Mapping[int, Mapping[int, int]]  # by hypothesis: id of a merged object -> id of the object it is now

    @classmethod
    def nothing(cls, root_ids: Sequence[int]) -> Self:
        """The report before any keyframe."""
        return cls({number: () for number in root_ids}, (), np.zeros((0, len(root_ids)), dtype=bool), {})

    @classmethod
    def of(
        cls,
        lineages: Mapping[int, Lineage],
        changes: Sequence[tuple[Change, ...]],
        tells: Flags,
        renamed: Mapping[int, Mapping[int, int]],
    ) -> Self:
        """A report from copies of its arguments, which may change later."""
        return cls(dict(lineages), tuple(changes), tells.copy(), dict(renamed))

    def take(self, rows: Index) -> Self:
        """The report with some of the alternatives; ``rows`` of alternatives newer than it are ignored."""
        known = rows[rows < len(self.changes)]
        return replace(self, changes=tuple(self.changes[row] for row in known), tells=self.tells[known])

    def tells_any(self, count: int) -> Flags:
        """(R',) which of ``count`` alternatives some hypothesis reports."""
        found = np.zeros(count, dtype=bool)
        found[: len(self.tells)] = self.tells.any(axis=1)
        return found

    @cached_property
    def columns(self) -> dict[int, int]:
        """Hypothesis id -> its column."""
        return {number: column for column, number in enumerate(self.lineages)}

    @cached_property
    def rows_at(self) -> dict[Place, list[int]]:
        """Rows of the alternatives that change a detection, by keyframe and detection; ascending."""
        found: dict[Place, list[int]] = {}
        for row, changes in enumerate(self.changes):
            for keyframe, detection, _ in changes:
                found.setdefault((keyframe, detection), []).append(row)
        return found

    def object_at(self, number: int, place: Place) -> int:
        """Object id that a hypothesis reports for a detection: of the newest alternative reported, else its own."""
        told = self.tells[:, self.columns[number]]
        for row in reversed(self.rows_at.get(place, ())):
            if told[row]:
                found = next(object_id for *where, object_id in self.changes[row] if tuple(where) == place)
                return self.renamed.get(number, {}).get(found, found)
        return self.lineages[number][place[0]].association[place[1]]

    def places(self, rows: Index) -> set[Place]:
        """The detections that some alternatives associate with other objects."""
        return {(keyframe, detection) for row in rows for keyframe, detection, _ in self.changes[row]}


def told_changes(before: Told, now: Told, live: Mapping[int, Hypothesis]) -> list[tuple[int, int, int, int]]:
    """(hypothesis, keyframe, detection, object or -1) where live hypotheses report otherwise than their parents did."""
    found = []
    for number, hypothesis in live.items():
        for place in sorted(_touched(before, now, number, hypothesis)):
            object_id = now.object_at(number, place)
            if object_id != before.object_at(hypothesis.told_parent_id, place):
                found.append((number, *place, object_id))
    return found


def _touched(before: Told, now: Told, number: int, hypothesis: Hypothesis) -> set[Place]:
    """Detections where a hypothesis's report may differ from its parent's.

    These are detections of alternatives that it reports newly or no longer; for a revision, of all that either reports,
    and those that the revision changes.
    """
    told = now.tells[:, now.columns[number]]
    parent = np.zeros(len(told), dtype=bool)
    parent[: len(before.tells)] = before.tells[:, before.columns[hypothesis.told_parent_id]]
    if hypothesis.revises is None:
        return now.places(np.flatnonzero(told != parent))
    newest = len(hypothesis.lineage) - 1  # the newest keyframe, of which no parent reported anything
    revised = {(keyframe, detection) for keyframe, detection, _ in hypothesis.changes() if keyframe < newest}
    return revised | now.places(np.flatnonzero(told | parent))
