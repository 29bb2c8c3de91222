"""The registry of the objects of a run: mapped ones, and those that detections introduced; which are reported.

The registry is a function of the map prior and of the keyframes so far, so that managers and backends that have seen
the same keyframes agree on it.
"""

import sys
from array import array
from bisect import bisect_right
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.states.gaussian import GaussianPrior
from semantic_slam.inference.world.displaced_objects import Displaced
from semantic_slam.inference.world.identities import objects_by_identity


@dataclass(frozen=True, kw_only=True)
class ObjectEntry:
    """An object that is known before the run, with its priors."""

    object_id: int
    name: str
    prior: GaussianPrior
    class_prior: Array  # (C,) probabilities
    existence: float = 1.0


@dataclass(frozen=True, kw_only=True)
class ReportedObjects:
    """O objects in the order in which a belief states them; C classes."""

    ids: tuple[int, ...]  # O
    names: tuple[str, ...]  # O
    class_prior: Array  # (O, C) probabilities
    displaced: Displaced = field(default_factory=Displaced)  # ids of displaced twins of mapped objects

    @cached_property
    def row_of(self) -> dict[int, int]:
        """Object id -> row; a displaced twin has the row of its mapped object."""
        rows = {n: row for row, n in enumerate(self.ids)}
        return rows | {other: rows[own] for own, other in self.displaced.elsewhere.items() if own in rows}

    @cached_property
    def log_class_prior(self) -> Array:
        """(O, C) log prior class probabilities of the reported objects, in nats, read-only."""
        with np.errstate(divide="ignore"):
            logs = np.log(self.class_prior)
        logs.setflags(write=False)
        return logs

    def rows(self, object_ids: NDArray[np.int64]) -> NDArray[np.int32]:
        """Rows for an array of object ids; -1 (clutter) stays -1, and so do objects that are not reported."""
        rows = [self.row_of.get(n, -1) for n in object_ids.ravel().tolist()]
        return np.array(rows, dtype=np.int32).reshape(object_ids.shape)


class ObjectRegistry:
    """Ids, names and class priors of the objects, map prior first, then those that detections introduced."""

    STATE: ClassVar[tuple[str, ...]] = (
        "_known",
        "_by_name",
        "_first_new",
        "_labels",
        "_alive",
        "_reported",
        "_all",
        "_stated",
    )

    def __init__(self, entries: Sequence[ObjectEntry], class_shares: Array, displaced: Displaced | None = None):
        """Start from the mapped objects; ``class_shares`` (C,) is the class prior of objects that are not mapped."""
        self._displaced = Displaced() if displaced is None else displaced
        self._unknown = class_shares
        self._known = {entry.object_id: (entry.name, entry.class_prior) for entry in entries}
        own = {entry.object_id: entry.name for entry in entries if entry.object_id not in self._displaced.on_map}
        self._by_name = objects_by_identity(own)
        self._first_new = array("q", [max(self._known, default=-1) + 1])  # first reserved id of each keyframe
        self._labels: list[tuple[str, ...]] = []  # labels of each keyframe's detections; () where none has one
        self._alive: frozenset[int] = frozenset()
        self._reported = self._all = self._listed(tuple(self._known))
        self._stated = self._each_once()

    @property
    def known(self) -> ReportedObjects:
        """All objects with an identity: those of the map with their displaced twins, and those named by detections."""
        return self._all

    @property
    def stated(self) -> ReportedObjects:
        """All ``known`` objects once each: displaced twins share the row of their mapped objects."""
        return self._stated

    def alive(self, object_ids: Collection[int]) -> ReportedObjects:
        """The objects that some open-world hypothesis holds, ascending by id; unmapped ones are named by their id."""
        alive = frozenset(object_ids)
        if alive != self._alive:
            self._alive, self._reported = alive, self._listed(tuple(sorted(alive)))
        return self._reported if alive else self._listed(())

    def identify(self, name: str) -> int:
        """Object id of an identity given with a detection, see :func:`objects_by_identity`.

        A new identity becomes a new object; "" gives -1 (none).
        """
        if not name:
            return -1
        if name not in self._by_name:
            number = max(self._known, default=-1) + 1
            self._known[number] = name, self._unknown
            self._by_name[name] = number
            self._all, self._stated = self._listed(tuple(self._known)), self._each_once()
        return self._by_name[name]

    def reserve(self, index: int, num_detections: int, labels: Sequence[str] = ()) -> None:
        """Reserve ids for objects born from the detections of keyframe ``index``; keyframes come in order.

        ``labels`` (D,) are the detector's labels, () where they are not used.
        """
        if index == len(self._first_new) - 1:
            self._labels.append(tuple(sys.intern(str(label)) for label in labels) if any(labels) else ())
            self._first_new.append(self._first_new[-1] + num_detections)

    def label_of(self, object_id: int) -> str:
        """Detector's label of the detection from which an object was born; "" for mapped ones or without labels."""
        keyframe = bisect_right(self._first_new, object_id) - 1
        if not 0 <= keyframe < len(self._labels):
            return ""
        labels, place = self._labels[keyframe], object_id - self._first_new[keyframe]
        return labels[place] if place < len(labels) else ""

    def first_new_id(self, index: int) -> int:
        """Id of the object born from the first detection of keyframe ``index``; those of the others follow."""
        return self._first_new[index]

    def log_class_prior_of(self, object_ids: Sequence[int]) -> Array:
        """(n, C) log prior class probabilities (natural) of some objects."""
        known = [self._known[n][1] if n in self._known else self._unknown for n in object_ids]
        with np.errstate(divide="ignore"):
            return np.asarray(np.log(np.array(known).reshape(len(object_ids), len(self._unknown))))

    def _each_once(self) -> ReportedObjects:
        ids = tuple(number for number in self._known if number not in self._displaced.on_map)
        return replace(self._listed(ids), displaced=self._displaced)

    def _listed(self, ids: tuple[int, ...]) -> ReportedObjects:
        rows = [self._known.get(n, (str(n), self._unknown)) for n in ids]
        prior = np.array([prior for _, prior in rows]).reshape(len(ids), len(self._unknown))
        return ReportedObjects(ids=ids, names=tuple(name for name, _ in rows), class_prior=prior)
