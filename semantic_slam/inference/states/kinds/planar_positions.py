"""Planar positions, the vector space R^2, as a state space: of points, and of problems with closed forms."""

from dataclasses import dataclass

import gtsam
import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.states.kinds.positions import Positions


@dataclass(frozen=True)
class PlanarPositions(Positions):
    """R^2: x, y [m]. With linear models every belief of the engine is exact here."""

    tangent_size = 2
    storage_size = 2
    frame_size = 2
    position_rows = slice(0, 2)
    origin = np.full(2, 0.7)
    relinearize_threshold = np.array([0.1, 0.1])
    far = np.array([5.0, 5.0])
    prior = gtsam.PriorFactorPoint2
    between_points = gtsam.BetweenFactorPoint2

    def state(self, values: gtsam.Values, key: int) -> Array:
        return np.asarray(values.atPoint2(key))

    def states(self, values: gtsam.Values) -> Array:
        return np.asarray(gtsam.utilities.extractPoint2(values))
