"""Which objects exist, in the order in which the run came to know them.

The registry is a function of the map prior and of the keyframes so far, so that managers and backends that
have seen the same keyframes agree on it.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.states.gaussian import GaussianPrior


@dataclass(frozen=True)
class ObjectEntry:
    """An object known from the start."""

    object_id: int
    name: str
    prior: GaussianPrior
    class_prior: Array  # (C,) probabilities
    existence: float = 1.0


class ObjectRegistry:
    """Ids, names and class priors of the objects, map prior first, then those that detections introduced."""

    def __init__(self, entries: Sequence[ObjectEntry], num_classes: int):
        self.ids = [entry.object_id for entry in entries]
        self.names = [entry.name for entry in entries]
        self._class_priors = [entry.class_prior for entry in entries]
        self._existence = [entry.existence for entry in entries]
        self._uniform = np.full(num_classes, 1.0 / max(num_classes, 1))
        self._by_name = {name: n for n, name in zip(self.ids, self.names, strict=True)}
        self._by_name |= {str(n): n for n in self.ids}
        self._tabulate()
        self._first_new = [max(self.ids, default=-1) + 1]  # by keyframe

    def _tabulate(self) -> None:
        """What is asked for every hypothesis."""
        self.row_of = {n: row for row, n in enumerate(self.ids)}  # id -> position in ``ids``
        self._class_prior = np.array(self._class_priors).reshape(len(self.ids), len(self._uniform))
        with np.errstate(divide="ignore"):
            self._log_class_prior = np.log(self._class_prior)
        self._log_class_prior.setflags(write=False)

    def identify(self, name: str) -> int:
        """Object id of an identity given with a detection; a new identity becomes a new object, "" is no object."""
        if not name:
            return -1
        if name not in self._by_name:
            number = max(self.ids, default=-1) + 1
            self.ids.append(number)
            self.names.append(name)
            self._class_priors.append(self._uniform)
            self._existence.append(1.0)
            self._by_name[name] = number
            self._tabulate()
        return self._by_name[name]

    def introduce(self, index: int, num_detections: int) -> None:
        """Reserve ids for the detections of keyframe ``index`` in an open world; keyframes come in order."""
        if index == len(self._first_new) - 1:
            self._first_new.append(self._first_new[-1] + num_detections)

    def first_new_id(self, index: int) -> int:
        """Id of the object that the first detection of keyframe ``index`` would start; the next ones follow."""
        return self._first_new[index]

    def log_class_prior_of(self, object_ids: Sequence[int]) -> Array:
        """(n, C) natural logs; what no map knows may be of any class."""
        known = [self._class_priors[self.row_of[n]] if n in self.row_of else self._uniform for n in object_ids]
        with np.errstate(divide="ignore"):
            return np.asarray(np.log(np.array(known).reshape(len(object_ids), len(self._uniform))))

    def index(self, object_id: int) -> int:
        """Position of an object in ``ids``."""
        return self.row_of[object_id]

    def indices(self, object_ids: NDArray[np.int64]) -> NDArray[np.int32]:
        """Positions in ``ids`` of an array of object ids; -1 stays -1."""
        place = self.row_of | {-1: -1}
        return np.array([place[int(n)] for n in object_ids.ravel()], dtype=np.int32).reshape(object_ids.shape)

    def class_prior(self) -> Array:
        """(O, C) probabilities."""
        return self._class_prior.copy()

    def existence(self) -> Array:
        """(O,) probabilities, as the map prior states them: a fixed number of objects is not doubted."""
        return np.array(self._existence, dtype=np.float64)

    def log_class_prior(self) -> Array:
        """(O, C) natural logs."""
        return self._log_class_prior


class ReportedObjects(ObjectRegistry):
    """The objects that some hypothesis of an open world holds at one keyframe, ascending by id."""

    def __init__(self, entries: Sequence[ObjectEntry], num_classes: int, alive: Collection[int]):
        """``entries`` of the map prior; every other object may be of any class and has its number as its name."""
        uniform = np.full(num_classes, 1.0 / max(num_classes, 1))
        known = {entry.object_id: (entry.name, entry.class_prior) for entry in entries}
        super().__init__((), num_classes)
        self._entries = entries
        self.ids = sorted(alive)
        self.names = [known[n][0] if n in known else str(n) for n in self.ids]
        self._class_priors = [known[n][1] if n in known else uniform for n in self.ids]
        self._tabulate()

    def with_only(self, alive: Collection[int]) -> "ReportedObjects":
        """Of other objects; the same one where they are the same."""
        return self if sorted(alive) == self.ids else ReportedObjects(self._entries, len(self._uniform), alive)

    def indices(self, object_ids: NDArray[np.int64]) -> NDArray[np.int32]:
        """Positions in ``ids``; -1 for what is not there."""
        rows = [self.row_of.get(n, -1) for n in object_ids.ravel().tolist()]
        return np.array(rows, dtype=np.int32).reshape(object_ids.shape)
