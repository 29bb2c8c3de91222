"""What hypotheses tell of their past, and where that is not what was told before."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from semantic_slam.geometry.arrays import Flags, Index
from semantic_slam.inference.alternatives.differences import Change
from semantic_slam.inference.alternatives.heirs import Lineage
from semantic_slam.inference.hypotheses import Hypothesis

Place = tuple[int, int]
"""Keyframe and detection."""


@dataclass(frozen=True)
class Told:
    """What H hypotheses tell, by their ids, of R alternatives."""

    lineages: Mapping[int, Lineage]  # H, as they are followed
    changes: Sequence[tuple[Change, ...]]  # R
    tells: Flags  # (R, H) whether a hypothesis tells an alternative
    renamed: Mapping[int, Mapping[int, int]]  # objects that are one with another in a hypothesis -> that one

    @classmethod
    def nothing(cls, root_ids: Sequence[int]) -> Self:
        """Before any keyframe."""
        return cls({number: () for number in root_ids}, (), np.zeros((0, len(root_ids)), dtype=bool), {})

    @classmethod
    def of(
        cls,
        lineages: Mapping[int, Lineage],
        changes: Sequence[tuple[Change, ...]],
        tells: Flags,
        renamed: Mapping[int, Mapping[int, int]],
    ) -> Self:
        """Copies: what is told stays."""
        return cls(dict(lineages), tuple(changes), tells.copy(), dict(renamed))

    def take(self, rows: Index) -> Self:
        """Some of the alternatives; those that are newer than what was told count as not told."""
        known = rows[rows < len(self.changes)]
        return replace(self, changes=tuple(self.changes[row] for row in known), tells=self.tells[known])

    def tells_any(self, count: int) -> Flags:
        """(R',) of so many alternatives, which somebody tells."""
        found = np.zeros(count, dtype=bool)
        found[: len(self.tells)] = self.tells.any(axis=1)
        return found

    @cached_property
    def columns(self) -> dict[int, int]:
        """Hypothesis -> its column."""
        return {number: column for column, number in enumerate(self.lineages)}

    @cached_property
    def rows_at(self) -> dict[Place, list[int]]:
        """Alternatives that have a detection of another object, by the detection; ascending."""
        found: dict[Place, list[int]] = {}
        for row, changes in enumerate(self.changes):
            for keyframe, detection, _ in changes:
                found.setdefault((keyframe, detection), []).append(row)
        return found

    def object_at(self, number: int, place: Place) -> int:
        """What a hypothesis tells: by the newest alternative that it tells of this detection, else what it follows."""
        told = self.tells[:, self.columns[number]]
        for row in reversed(self.rows_at.get(place, ())):
            if told[row]:
                found = next(object_id for *where, object_id in self.changes[row] if tuple(where) == place)
                return self.renamed.get(number, {}).get(found, found)
        return self.lineages[number][place[0]].association[place[1]]

    def places(self, rows: Index) -> set[Place]:
        """The detections that some alternatives have of other objects."""
        return {(keyframe, detection) for row in rows for keyframe, detection, _ in self.changes[row]}


def told_changes(before: Told, now: Told, live: Mapping[int, Hypothesis]) -> list[tuple[int, int, int, int]]:
    """(hypothesis, keyframe, detection, object or -1) where the live ones differ from what their parents told."""
    found = []
    for number, own in live.items():
        for place in sorted(_touched(before, now, number, own)):
            object_id = now.object_at(number, place)
            if object_id != before.object_at(own.told_parent_id, place):
                found.append((number, *place, object_id))
    return found


def _touched(before: Told, now: Told, number: int, own: Hypothesis) -> set[Place]:
    """Where that may be: at what it tells anew or no longer, and at all that it tells where it was revised."""
    told = now.tells[:, now.columns[number]]
    parent = np.zeros(len(told), dtype=bool)
    parent[: len(before.tells)] = before.tells[:, before.columns[own.told_parent_id]]
    if own.revises is None:
        return now.places(np.flatnonzero(told != parent))
    newest = len(own.lineage) - 1  # of that no parent told
    revised = {(keyframe, detection) for keyframe, detection, _ in own.changes() if keyframe < newest}
    return revised | now.places(np.flatnonzero(told | parent))
