"""The objects of one hypothesis in an open world: how surely each exists, and where it was after the last update."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int_]


@dataclass(frozen=True)
class Population:
    """O objects, ascending by id; d dimensions of a state, T keyframes so far."""

    ids: Index  # (O,)
    existence: Array  # (O,)
    states: Array  # (O, d) after the newest update
    covariances: Array  # (O, d, d) when the object was last near: later updates only narrow it
    robot_covariance: Array  # (d, d) after the newest update
    trail: Array  # (T, d) robot at each keyframe, as estimated then
    given_up: int = 0  # objects removed so far for want of existence

    def rows(self, object_ids: Index) -> Index:
        """Where (n,) objects stand; all of them must be there."""
        return np.asarray(np.searchsorted(self.ids, object_ids))

    def holds(self, object_ids: Index) -> NDArray[np.bool_]:
        """(n,) which objects are there."""
        if not len(self.ids):
            return np.zeros(len(object_ids), dtype=bool)
        return np.asarray(self.ids[np.minimum(self.rows(object_ids), len(self.ids) - 1)] == object_ids)
