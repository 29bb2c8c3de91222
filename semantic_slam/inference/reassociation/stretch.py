"""The last stretch of a drive, split from what was known before it, and which objects of the two parts are one."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.reassociation.atoms import Born
from semantic_slam.inference.reassociation.joint_pairs import JointPairs
from semantic_slam.inference.smoothing.component import Component, tracked_states
from semantic_slam.inference.smoothing.reassociation import Sighted
from semantic_slam.inference.smoothing.smoother import Smoother
from semantic_slam.inference.states.keys import object_key
from semantic_slam.inference.states.tracked_objects import HypothesisObjects

ABSENT = 50
"""Keyframes without a detection after which the next one is a return (loop closure), which may be mistaken."""
LARGEST_DISTANCE_M = 8.0
"""Distance [m] between two objects of a split drive up to which they may be one."""
STRANGE_M, LEAST_STRANGE = 3.0, 4
"""Distance [m] of a new object from a known one, and number of such new objects, from which on a stretch is
suspicious."""


@dataclass(frozen=True)
class Stretch:
    """N objects of n detections, in which an object that returns in the stretch is two: before it, and in it."""

    sighted: Sighted  # n detections of the history as it is
    objects: Index  # (n,) object ids after splitting
    started: dict[int, int]  # id of a second part -> id of the object it was split from
    ids: Index  # (N,) ascending, without dropped objects
    first: Index  # (N,) keyframe of the first detection
    last: Index  # (N,)
    times: Index  # (N,) number of detections
    begin: int  # keyframe

    @classmethod
    def of(cls, sighted: Sighted, objects: HypothesisObjects, begin: int, born: Born) -> Self:
        """The stretch from keyframe ``begin`` on."""
        parted, started = sighted.objects.copy(), dict[int, int]()
        late = np.unique(sighted.objects[sighted.keyframes >= begin])
        for number in late[np.isin(late, objects.ids)].tolist():
            rows = np.flatnonzero(sighted.objects == number)
            times = sighted.keyframes[rows]
            returns = np.flatnonzero((np.diff(times) >= ABSENT) & (times[1:] >= begin))
            if len(returns):
                part = rows[returns[0] + 1 :]
                name = born(int(sighted.keyframes[part[0]]), int(sighted.numbers[part[0]]))
                parted[part], started[name] = name, number
        ids, place = np.unique(parted, return_inverse=True)
        first, last = np.full(len(ids), np.iinfo(int).max), np.full(len(ids), -1)
        np.minimum.at(first, place, sighted.keyframes)
        np.maximum.at(last, place, sighted.keyframes)
        kept = np.isin(ids, np.append(objects.ids, list(started)))
        times = np.bincount(place)
        return cls(sighted, parted, started, ids[kept], first[kept], last[kept], times[kept], begin)

    def looks_strange(self, component: Component) -> bool:
        """Whether several objects were started next to known ones that have not been seen since."""
        known = np.isin(self.ids, component.objects.ids)
        young = known & (self.first >= self.begin) & (self.times > 1)
        old = known & (self.last + ABSENT < self.first[young].max(initial=-1))
        states = tracked_states(component).states[:, :2]
        at = component.objects.rows(self.ids[known])
        places = np.zeros((len(self.ids), 2))
        places[known] = states[at]
        away = places[young][:, None] - places[old]
        near = (np.hypot(away[..., 0], away[..., 1]) < STRANGE_M).any(axis=1)
        return int(near.sum()) >= LEAST_STRANGE

    def best_joins(self, smoother: Smoother, log_new: float) -> Index:
        """(m, 2) ids of pairs of the split drive to merge, the older first."""
        places = smoother.states([object_key(int(number)) for number in self.ids])[:, :2]
        pairs = self._pairs(places)
        if not len(pairs):
            return np.zeros((0, 2), dtype=int)
        rows, numbers = np.unique(pairs, return_inverse=True)
        numbers = numbers.reshape(pairs.shape)
        keys = [object_key(int(number)) for number in self.ids[rows]]
        covariance = _in_map(smoother, keys)
        _, chosen = JointPairs(places[rows], covariance, numbers, log_new).best()
        return np.asarray(self.ids[pairs[chosen]]).reshape(-1, 2)

    def joined(self, joins: Index) -> Index:
        """(n,) object ids of the detections with each pair of ``joins`` (m, 2) merged under the older id."""
        name = {int(younger): int(older) for older, younger in joins}
        found = self.objects.copy()
        for number in np.unique(found).tolist():
            root = number
            while root in name:
                root = name[root]
            if root != number:
                found[self.objects == number] = root
        return found

    def _pairs(self, places: Array) -> Index:
        """(n, 2) rows of pairs of an older object, unseen for long, and one that started in the stretch."""
        young = np.flatnonzero(self.first >= self.begin)
        away = places[young][:, None] - places
        may = np.hypot(away[..., 0], away[..., 1]) < LARGEST_DISTANCE_M
        may &= self.last + ABSENT <= self.first[young][:, None]
        at, older = np.nonzero(may)
        return np.stack([older, young[at]], axis=1)


def _in_map(smoother: Smoother, keys: list[int]) -> Array:
    """(2 N, 2 N) joint covariance of object positions along the axes of map. Raises LostComponentError."""
    space, states = smoother.spaces.landmark, smoother.states(keys)
    size, count = space.tangent_size, len(keys)
    axes = np.tile(np.eye(2, size), (count, 1, 1))
    if space.heading is not None:
        cos, sin = np.cos(states[:, space.heading]), np.sin(states[:, space.heading])
        axes[:, :, :2] = np.stack([np.stack([cos, -sin], axis=1), np.stack([sin, cos], axis=1)], axis=1)
    blocks = smoother.joint_covariance(keys).reshape(count, size, count, size).transpose(0, 2, 1, 3)
    turned = axes[:, None] @ blocks @ np.swapaxes(axes, 1, 2)[None]
    return np.asarray(turned.transpose(0, 2, 1, 3).reshape(2 * count, 2 * count))
