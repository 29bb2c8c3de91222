"""Which objects exist, in the order in which the run came to know them.

The registry is a function of the map prior and of the keyframes so far, so that managers and backends that
have seen the same keyframes agree on it.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from semantic_slam.inference.problem import ObjectEntry

Array = NDArray[np.float64]


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
        return self._by_name[name]

    def index(self, object_id: int) -> int:
        """Position of an object in ``ids``."""
        return self.ids.index(object_id)

    def indices(self, object_ids: NDArray[np.int64]) -> NDArray[np.int32]:
        """Positions in ``ids`` of an array of object ids; -1 stays -1."""
        place = {n: i for i, n in enumerate(self.ids)} | {-1: -1}
        return np.array([place[int(n)] for n in object_ids.ravel()], dtype=np.int32).reshape(object_ids.shape)

    def class_prior(self) -> Array:
        """(O, C) probabilities."""
        return np.array(self._class_priors).reshape(len(self.ids), len(self._uniform))

    def existence(self) -> Array:
        """(O,) probabilities, as the map prior states them: a fixed number of objects is not doubted."""
        return np.array(self._existence, dtype=np.float64)

    def log_class_prior(self) -> Array:
        """(O, C) natural logs."""
        with np.errstate(divide="ignore"):
            return np.log(self.class_prior())
