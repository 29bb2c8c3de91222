"""Merging of near-duplicate hypotheses of an open world, found among the candidates of a keyframe."""

from collections import Counter
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import ClassVar, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.moments import position_sigmas
from semantic_slam.inference.open_world.merging import MergeCandidates, merge_copies
from semantic_slam.inference.pruning import Kinds, admitted
from semantic_slam.inference.states.identity import ROOT_ID
from semantic_slam.inference.states.lineage import Lineage
from semantic_slam.inference.world.objects import ObjectRegistry, ReportedObjects
from semantic_slam.inference.world.problem import Problem

SURE = 0.5
"""Existence above which an object must be present in both hypotheses for them to be copies."""
MOVING = 0.5
"""Probability of moving above which an object must not stand still in the other hypothesis."""


@dataclass(frozen=True, kw_only=True)
class RecentAssociations:
    """The associations of a hypothesis's last keyframes, R detections."""

    objects: Array  # (R, 3) current position of each one's object; NaN if dropped
    classes: Index  # (R,) -1 where classes are not enumerated
    confirms: NDArray[np.bool_]  # (R,) whether the detection is the second one of its object
    sure: dict[int, Array] = field(default_factory=dict)  # id -> (3,) position of likely static objects
    movers: dict[int, Array] = field(default_factory=dict)  # id -> (4,) position and its sigma of moving ones
    root_number: int = 0  # of the hypothesis: its noise setting and start
    ground: int = 0  # keyframe since which the robot is on new ground
    tentative: Collection[int] = ()  # objects with a single detection, a recent one


class MergeableCandidates(Protocol):
    """The interface needed of K candidates of a keyframe with D detections."""

    @property
    def ids(self) -> NDArray[np.uint64]:
        """(K,) hypothesis ids of the candidates."""

    @property
    def parent_ids(self) -> NDArray[np.uint64]:
        """(K,) ids of the hypotheses that the candidates continue."""

    @property
    def associations(self) -> NDArray[np.int32]:
        """(K, D) object id that each detection is associated with."""

    @property
    def classes(self) -> NDArray[np.int32]:
        """(K, D) class that each detection's object is taken to have."""

    @property
    def log_weights(self) -> Array:
        """(K,) log weights of the candidates."""

    @property
    def poses(self) -> Array:
        """(K, 7) robot poses in map."""

    @property
    def object_poses(self) -> Array:
        """(K, D, 7) poses in map of the objects that detections are associated with."""

    def take(self, rows: Index, log_weights: Array) -> Self:
        """The chosen candidates, with new log weights."""


C = TypeVar("C", bound=MergeableCandidates)


class Survivor(Protocol):
    """The interface needed of a hypothesis that survives."""

    @property
    def lineage(self) -> Lineage:
        """One step for every keyframe."""

    @property
    def grounds(self) -> tuple[int, ...]:
        """Keyframes before which it was carried to new ground."""


class Placed(Protocol):
    """The interface needed of the objects of a hypothesis."""

    @property
    def object_poses(self) -> Array:
        """(O, 7) poses; NaN where the hypothesis has no such object."""

    @property
    def object_covariances(self) -> Array:
        """(O, 6, 6) covariances of the poses."""

    @property
    def existence(self) -> Array:
        """(O,) existence probabilities, NaN where the hypothesis has no such object."""

    @property
    def moving(self) -> Array:
        """(O,) probabilities of moving; empty where nothing does."""


class Distinct:
    """No merging: in a world of known objects no hypothesis becomes the copy of another."""

    STATE: ClassVar[tuple[str, ...]] = ()
    num_merged = 0

    def merged(self, candidates: C) -> C:
        """The candidates unchanged: known objects leave no copies to merge."""
        return candidates

    def remember(
        self,
        live: Mapping[int, Survivor],
        objects: Mapping[int, Placed],
        reported: ReportedObjects,
        registry: ObjectRegistry,
    ) -> None:
        """Do nothing."""


class Copies:
    """Finds near copies by the recent associations of hypotheses.

    ``num_merged`` counts the hypotheses merged at the newest keyframe.
    """

    STATE: ClassVar[tuple[str, ...]] = ("_recent", "num_merged")

    def __init__(self, problem: Problem):
        self.settings, self._limits = problem.open_world, problem.pruning
        self.num_merged, self._is_spatial = 0, problem.spaces.name == "spatial"
        nothing = RecentAssociations(
            objects=np.zeros((0, 3)), classes=np.zeros(0, dtype=int), confirms=np.zeros(0, dtype=bool)
        )
        self._recent = {
            ROOT_ID + number: replace(nothing, root_number=number) for number in range(len(problem.noise_settings))
        }

    def merged(self, candidates: C) -> C:
        """The candidates, with near copies merged among those that pruning might keep: of every place and root."""
        log_weights = candidates.log_weights
        likely = admitted(log_weights, candidates.ids, self._limits, self._kinds(candidates))
        self.num_merged = 0
        if len(likely) < 2:
            return candidates
        compared = self._compared(candidates, likely)
        merged = merge_copies(compared, log_weights[likely], candidates.ids[likely], self.settings)
        self.num_merged = merged.count
        unlikely = np.delete(np.arange(len(log_weights)), likely)
        rows = np.concatenate([likely[merged.kept], unlikely]).astype(int)
        return candidates.take(rows, np.concatenate([merged.log_weights, log_weights[unlikely]]))

    def _kinds(self, candidates: MergeableCandidates) -> Kinds:
        """Attributes by which pruning tells kinds of candidates apart."""
        roots = [self._recent[number].root_number for number in candidates.parent_ids.tolist()]
        return Kinds(positions=candidates.poses[:, :3], root_numbers=np.array(roots, dtype=int))

    def _compared(self, candidates: MergeableCandidates, likely: Index) -> MergeCandidates:
        """The properties by which some candidates are compared."""
        recent = [self._recent[int(candidates.parent_ids[row])] for row in likely]
        roots = np.array([[item.root_number, item.ground] for item in recent])
        parents, numbers = np.unique(candidates.parent_ids[likely], return_inverse=True)
        before = np.array([item.objects for item in recent]).reshape(len(likely), -1, 3)
        known = np.array([item.classes for item in recent], dtype=int).reshape(len(likely), -1)
        confirmed = np.array([item.confirms for item in recent], dtype=bool).reshape(len(likely), -1)
        associated = zip(candidates.associations[likely], recent, strict=True)
        second = [[n in item.tentative for n in association] for association, item in associated]
        now = np.array(second, dtype=bool).reshape(len(likely), -1)
        return MergeCandidates(
            poses=candidates.poses[likely],
            objects=np.concatenate([before, candidates.object_poses[likely, :, :3]], axis=1),
            classes=np.concatenate([known, candidates.classes[likely], roots], axis=1),
            confirms=np.concatenate([confirmed, now], axis=1),
            parents=numbers,
            alike=self._alike([self._recent[int(n)] for n in parents]),
            is_spatial=self._is_spatial,
        )

    def _alike(self, recent: list[RecentAssociations]) -> NDArray[np.bool_]:
        """(P, P) whether two hypotheses agree on which objects surely exist; ids may differ."""
        alike = np.ones((len(recent), len(recent)), dtype=bool)
        if self.settings.merge_ghosts:
            return alike
        for a, b in combinations(range(len(recent)), 2):
            one, other, limit = recent[a], recent[b], self.settings.merge_object_m
            same = _both_near(one.sure, other.sure, limit) and _both_near(one.movers, other.movers, limit)
            alike[a, b] = alike[b, a] = same
        return alike

    def remember(
        self,
        live: Mapping[int, Survivor],
        objects: Mapping[int, Placed],
        reported: ReportedObjects,
        registry: ObjectRegistry,
    ) -> None:
        """Record where the objects of the survivors' recent detections are; rows of ``objects`` are as ``reported``."""
        self._recent = {n: self._recently(survivor, objects[n], reported, registry) for n, survivor in live.items()}

    def _recently(
        self, survivor: Survivor, objects: Placed, reported: ReportedObjects, registry: ObjectRegistry
    ) -> RecentAssociations:
        lineage = survivor.lineage
        first_new = registry.first_new_id(max(0, len(lineage) - self.settings.merge_keyframes))
        steps = lineage[-self.settings.merge_keyframes :]
        associated = np.array([n for step in steps for n in step.association], dtype=np.int64)
        classes = np.array([c for step in steps for c in step.class_assignment], dtype=int)
        padded = np.concatenate([objects.object_poses[:, :3], np.full((1, 3), np.nan)])
        times: Counter[int] = Counter()
        confirms = np.zeros(len(associated), dtype=bool)
        for row, object_id in enumerate(associated.tolist()):
            confirms[row] = object_id >= first_new and times[object_id] == 1
            times[object_id] += 1
        tentative = {object_id for object_id, count in times.items() if object_id >= first_new and count == 1}
        likely = np.zeros(0, dtype=int) if self.settings.merge_ghosts else np.flatnonzero(objects.existence > SURE)
        moves = objects.moving[likely] > MOVING if objects.moving.size else np.zeros(len(likely), dtype=bool)
        sure = {reported.ids[row]: objects.object_poses[row, :3] for row in likely[~moves]}
        vague = position_sigmas(objects.object_covariances[likely[moves]])
        movers = {
            reported.ids[row]: np.append(objects.object_poses[row, :3], sigma)
            for row, sigma in zip(likely[moves], vague, strict=True)
        }
        return RecentAssociations(
            objects=padded[reported.rows(associated)],
            classes=classes,
            confirms=confirms,
            sure=sure,
            movers=movers,
            root_number=lineage[0].mode,
            ground=max(survivor.grounds, default=0),
            tentative=tentative,
        )


def _both_near(one: dict[int, Array], other: dict[int, Array], limit_m: float) -> bool:
    """Whether every position that only one of them has is near one of the other's, both ways."""
    mine = [one[n] for n in one.keys() - other.keys()]
    theirs = [other[n] for n in other.keys() - one.keys()]
    return _all_near(mine, other, limit_m) and _all_near(theirs, one, limit_m)


def _all_near(points: list[Array], others: dict[int, Array], limit_m: float) -> bool:
    """Whether each point has one of the others near it; a fourth number is the point's own uncertainty [m]."""
    if not points or not others:
        return not points
    places, own = np.array(list(others.values()))[:, :3], np.array(points)
    limits = np.maximum(limit_m, own[:, 3:].max(axis=1, initial=0.0))
    return bool((np.linalg.norm(own[:, None, :3] - places, axis=-1) <= limits[:, None]).any(axis=1).all())
