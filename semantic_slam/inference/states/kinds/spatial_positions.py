"""Positions in space, the vector space R^3, as a state space: of objects whose orientation is not estimated."""

from dataclasses import dataclass

import gtsam
import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.states.kinds.positions import Positions


@dataclass(frozen=True)
class SpatialPositions(Positions):
    """R^3: x, y, z [m]."""

    tangent_size = 3
    storage_size = 3
    frame_size = 3
    position_rows = slice(0, 3)
    origin = np.full(3, 0.7)
    relinearize_threshold = np.full(3, 0.1)
    far = np.full(3, 5.0)
    prior = gtsam.PriorFactorPoint3
    between_points = gtsam.BetweenFactorPoint3

    def state(self, values: gtsam.Values, key: int) -> Array:
        return np.asarray(values.atPoint3(key))

    def states(self, values: gtsam.Values) -> Array:
        return np.asarray(gtsam.utilities.extractPoint3(values))
