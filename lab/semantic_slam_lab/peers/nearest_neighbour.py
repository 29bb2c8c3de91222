"""Individual nearest neighbour, the simplest front end, as an association strategy over an open world."""

import numpy as np

from semantic_slam.inference.association.gating import PairDensities, RankedAssignments
from semantic_slam.inference.open_world.keyframe.open_association import OpenAssociation
from semantic_slam.inference.open_world.prediction.prediction import Prediction


class NearestNeighbour(OpenAssociation):
    """Every detection by itself takes the nearest object inside its gate that none before it took."""

    def ranked(self, prediction: Prediction, pairs: PairDensities) -> RankedAssignments:
        """One assignment; what else could be is not asked."""
        known = len(prediction.near)
        distance = np.where(pairs.distance < self.settings.gate_sigma, pairs.distance, np.inf)
        columns: list[int] = []
        for number, row in enumerate(distance):
            left = np.where(np.isin(np.arange(known), columns), np.inf, row)
            found = known > 0 and np.isfinite(left.min())
            columns.append(int(np.argmin(left)) if found else known + number)
        return RankedAssignments(np.array([columns], dtype=int).reshape(1, -1), np.zeros(1), -np.inf)
