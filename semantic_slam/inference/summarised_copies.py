"""Merging of closed-world hypotheses that differ only in their marginalised past (fixed-lag smoothing).

An association that was ambiguous before the horizon leaves two histories that no later measurement can distinguish, and
every further ambiguity doubles their number. They are merged: the heavier one takes over the other's weight.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np

from semantic_slam.geometry.arrays import Flags, Index
from semantic_slam.inference.candidate_table import CandidateTable
from semantic_slam.inference.object_table import ObjectTable
from semantic_slam.inference.open_world.copies import Survivor
from semantic_slam.inference.open_world.merging import MergeCandidates, merge_copies
from semantic_slam.inference.states.lineage import Lineage
from semantic_slam.inference.world.objects import ObjectRegistry, ReportedObjects
from semantic_slam.inference.world.problem import Problem

CLASS_APART = 0.1
"""Difference of a class probability above which two hypotheses are taken to disagree on an object."""


class SummarisedCopies:
    """Finds and merges such duplicates among a keyframe's candidates; ``num_merged`` counts those of the newest."""

    STATE: ClassVar[tuple[str, ...]] = ("_recent", "_objects", "num_merged")

    def __init__(self, problem: Problem) -> None:
        self._settings = replace(problem.open_world, merge_ghosts=False)
        self._horizon = problem.history.horizon_keyframes
        self._recent: dict[int, Lineage] = {}
        self._objects: dict[int, ObjectTable] = {}
        self.num_merged = 0

    def merged(self, candidates: CandidateTable) -> CandidateTable:
        """The candidates without duplicates; unchanged while histories are not longer than the horizon."""
        self.num_merged = 0
        parents, numbers = np.unique(candidates.parent_ids, return_inverse=True)
        if len(parents) < 2 or not all(int(number) in self._recent for number in parents):
            return candidates
        count = len(candidates.ids)
        compared = MergeCandidates(
            poses=candidates.poses,
            objects=np.zeros((count, 0, 3)),
            classes=self._histories(candidates),
            confirms=np.zeros((count, 0), dtype=bool),
            parents=numbers,
            alike=self._alike([int(number) for number in parents]),
        )
        found = merge_copies(compared, candidates.log_weights, candidates.ids, self._settings)
        self.num_merged = found.count
        return candidates.take(found.kept, found.log_weights) if found.count else candidates

    def remember(
        self,
        live: Mapping[int, Survivor],
        objects: Mapping[int, ObjectTable],
        reported: ReportedObjects,
        registry: ObjectRegistry,
    ) -> None:
        """Store what candidates are compared by: the live hypotheses' lineages within the horizon, and their objects.

        A lineage that is not longer than the horizon is left out, as nothing of it is marginalised.
        """
        lineages = {number: own.lineage for number, own in live.items()}
        self._recent = {n: own[1 - self._horizon :] for n, own in lineages.items() if len(own) > self._horizon}
        self._objects = dict(objects)

    def _histories(self, candidates: CandidateTable) -> Index:
        """(K, 1) index of each candidate's lineage within the horizon: equal where the lineages are."""
        pasts = [(self._recent[int(parent)], candidates.step(row)) for row, parent in enumerate(candidates.parent_ids)]
        known = {past: number for number, past in enumerate(dict.fromkeys(pasts))}
        return np.array([[known[past]] for past in pasts])

    def _alike(self, parents: list[int]) -> Flags:
        """(P, P) whether two hypotheses agree on all objects: present, position and class probabilities."""
        tables = [self._objects[number] for number in parents]
        return np.array([[self._same(one, other) for other in tables] for one in tables])

    def _same(self, one: ObjectTable, other: ObjectTable) -> bool:
        apart = np.linalg.norm(one.object_poses[:, :3] - other.object_poses[:, :3], axis=1)
        both = np.isnan(one.object_poses[:, 0]) & np.isnan(other.object_poses[:, 0])
        classes = np.abs(one.class_probabilities - other.class_probabilities).max(axis=1, initial=0.0)
        return bool((both | (apart <= self._settings.merge_object_m)).all() and (classes <= CLASS_APART).all())
