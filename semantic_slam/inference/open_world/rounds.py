"""What a manager does besides in an open world: it lines up objects, merges near copies and keeps a time budget."""

import time
from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from semantic_slam.configuration import PruningConfiguration
from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.object_table import over
from semantic_slam.inference.objects import ReportedObjects
from semantic_slam.inference.open_world.merging import MergeCandidates, Merged, merge_copies
from semantic_slam.inference.problem import Problem
from semantic_slam.inference.protocol import Components
from semantic_slam.inference.states.identity import ROOT_ID
from semantic_slam.inference.states.lineage import LineageStep

SURE = 0.5
"""Existence from which on a hypothesis that lacks an object is no copy."""


@dataclass(frozen=True)
class RecentAssociations:
    """The detections of a hypothesis's last keyframes; R of them."""

    objects: Array  # (R, 3) where the object of each lies now, NaN when given up
    classes: Index  # (R,) -1 where classes are not enumerated
    settles: NDArray[np.bool_]  # (R,) whether the detection is the second one of its object
    sure: dict[int, Array] = field(default_factory=dict)  # id -> (3,) position of the objects that are likely to exist
    noise: int = 0  # of odometry, under which the hypothesis began
    tentative: Collection[int] = ()  # objects that one recent detection started, and none was associated with since


class OpenRounds:
    """One per manager; ``num_merged`` counts the near copies of the newest keyframe."""

    def __init__(self, problem: Problem):
        self.problem, self.settings = problem, problem.open_world
        self.roster = ReportedObjects(problem.objects, len(problem.class_names), ())
        self.num_merged = 0
        nothing = RecentAssociations(np.zeros((0, 3)), np.zeros(0, dtype=int), np.zeros(0, dtype=bool))
        self._recent = {
            ROOT_ID + number: replace(nothing, noise=number) for number in range(len(problem.noise_factors))
        }

    def merge(
        self,
        ids: NDArray[np.uint64],
        parent_ids: NDArray[np.uint64],
        log_weights: Array,
        poses: Array,
        object_poses: Array,
        associations: NDArray[np.int32],
        classes: NDArray[np.int32],
    ) -> Merged:
        """Candidates (K,) without near copies: ``poses`` (K, 7), ``object_poses`` (K, D, 7), the others (K, D)."""
        ratio = np.log(self.problem.pruning.ratio)
        likely = np.flatnonzero(log_weights >= log_weights.max(initial=-np.inf) - ratio)
        if len(likely) < 2:
            self.num_merged = 0
            return Merged(np.arange(len(log_weights)), log_weights, 0)
        recent = [self._recent[int(parent_ids[row])] for row in likely]
        noise = np.array([[item.noise] for item in recent])
        parents, numbers = np.unique(parent_ids[likely], return_inverse=True)
        alike = self._alike([self._recent[int(n)] for n in parents])
        before = np.array([item.objects for item in recent]).reshape(len(likely), -1, 3)
        known = np.array([item.classes for item in recent], dtype=int).reshape(len(likely), -1)
        settled = np.array([item.settles for item in recent], dtype=bool).reshape(len(likely), -1)
        second = [[n in item.tentative for n in associations[row]] for row, item in zip(likely, recent, strict=True)]
        now = np.array(second, dtype=bool).reshape(len(likely), -1)
        looks = MergeCandidates(
            poses[likely],
            np.concatenate([before, object_poses[likely, :, :3]], axis=1),
            np.concatenate([known, classes[likely], noise], axis=1),
            np.concatenate([settled, now], axis=1),
            numbers,
            alike,
        )
        merged = merge_copies(looks, log_weights[likely], ids[likely], self.settings)
        self.num_merged = merged.count
        unlikely = np.delete(np.arange(len(log_weights)), likely)
        rows = np.concatenate([likely[merged.kept], unlikely]).astype(int)
        return Merged(rows, np.concatenate([merged.log_weights, log_weights[unlikely]]), merged.count)

    def _alike(self, recent: list[RecentAssociations]) -> NDArray[np.bool_]:
        """(P, P) whether two hypotheses are sure of the same objects, which may differ in their numbers."""
        alike = np.ones((len(recent), len(recent)), dtype=bool)
        if self.settings.merge_ghosts:
            return alike
        for a, b in combinations(range(len(recent)), 2):
            one, other = recent[a].sure, recent[b].sure
            mine = [one[n] for n in one.keys() - other.keys()]
            theirs = [other[n] for n in other.keys() - one.keys()]
            limit = self.settings.merge_object_m
            alike[a, b] = alike[b, a] = _all_near(mine, other, limit) and _all_near(theirs, one, limit)
        return alike

    def aligned(self, answers: list[Components]) -> list[Components]:
        """Answers over the same objects: all that some hypothesis holds."""
        self.roster = self.roster.with_only({n for answer in answers for n in answer.object_ids.tolist()})
        ids = np.array(self.roster.ids, dtype=np.uint32)
        if all(np.array_equal(ids, answer.object_ids) for answer in answers):
            return answers
        priors = self.roster.class_prior()
        return [
            replace(
                answer, object_ids=ids, objects=over(answer.objects, np.searchsorted(ids, answer.object_ids), priors)
            )
            for answer in answers
        ]

    def remember(
        self, number: int, lineage: Sequence[LineageStep], object_poses: Array, existence: Array, first_new: int
    ) -> None:
        """Where the objects of recent detections of a hypothesis are; poses (O, 7) and existence (O,) over the roster.

        ``first_new``: the first id that was given in the keyframes that count as recent.
        """
        steps = lineage[-self.settings.merge_keyframes :]
        seen = np.array([n for step in steps for n in step.association], dtype=np.int64)
        classes = np.array([c for step in steps for c in step.class_assignment], dtype=int)
        places = self.roster.indices(seen)
        padded = np.concatenate([object_poses[:, :3], np.full((1, 3), np.nan)])
        times: Counter[int] = Counter()
        settles = np.zeros(len(seen), dtype=bool)
        for row, found in enumerate(seen.tolist()):
            settles[row] = found >= first_new and times[found] == 1
            times[found] += 1
        tentative = {found for found, count in times.items() if found >= first_new and count == 1}
        likely = () if self.settings.merge_ghosts else np.flatnonzero(existence > SURE)
        sure = {self.roster.ids[row]: object_poses[row, :3] for row in likely}
        self._recent[number] = RecentAssociations(padded[places], classes, settles, sure, lineage[0].mode, tentative)

    def forget(self) -> None:
        """Drop what is remembered of hypotheses before the newest keyframe."""
        self._recent.clear()


class TimeBudget:
    """Fewer hypotheses while keyframes take longer than the budget; ``budget_ms`` 0: no clock is read."""

    def __init__(self, budget_ms: float, limits: PruningConfiguration):
        self._budget_s, self._limits = budget_ms / 1e3, limits
        self._per_hypothesis_s = 0.0
        self._begun_s = 0.0

    @property
    def is_on(self) -> bool:
        return self._budget_s > 0.0

    def begin(self) -> None:
        """A keyframe begins."""
        if self.is_on:
            self._begun_s = time.perf_counter()

    def limits(self) -> PruningConfiguration:
        """Limits for pruning now: as many hypotheses as the time per hypothesis so far admits."""
        if not self.is_on or self._per_hypothesis_s <= 0.0:
            return self._limits
        affordable = max(1, int(self._budget_s / self._per_hypothesis_s))
        return replace(self._limits, max_hypotheses=min(affordable, self._limits.max_hypotheses))

    def end(self, num_hypotheses: int) -> None:
        """A keyframe ends; keyframes far apart in cost are smoothed over about five."""
        if self.is_on:
            taken = (time.perf_counter() - self._begun_s) / num_hypotheses
            known = self._per_hypothesis_s
            self._per_hypothesis_s = taken if known == 0.0 else 0.8 * known + 0.2 * taken


def _all_near(points: list[Array], others: dict[int, Array], limit_m: float) -> bool:
    """Whether each point has one of the others near it."""
    if not points or not others:
        return not points
    places = np.array(list(others.values()))
    return bool((np.linalg.norm(np.array(points)[:, None] - places, axis=-1) <= limit_m).any(axis=1).all())
