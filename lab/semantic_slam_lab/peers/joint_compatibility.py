"""Joint compatibility branch and bound (Neira and Tardós, IEEE T-RA 17(6), 2001) over an open world."""

from dataclasses import dataclass, field

import numpy as np
from scipy.stats import chi2

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.association.gating import PairDensities, RankedAssignments
from semantic_slam.inference.open_world.keyframe.open_association import OpenAssociation
from semantic_slam.inference.open_world.prediction.prediction import Prediction

CONFIDENCE = 0.99
"""Confidence of the chi-squared tests, of single pairs and of all pairs together."""
MOST_NODES = 20_000
"""Nodes of the tree that are looked at: the best found until then stands."""


class JointCompatibility(OpenAssociation):
    """The largest set of pairs that fits together, the closest of those; every other detection is a new object."""

    def ranked(self, prediction: Prediction, pairs: PairDensities) -> RankedAssignments:
        """One assignment; what else could be is not asked."""
        known, count = len(prediction.near), len(pairs.distance)
        columns = known + np.arange(count)
        if known and count:
            found = branch_and_bound(Innovations.of(prediction, pairs))
            columns = np.where(found >= 0, found, columns)
        return RankedAssignments(columns.reshape(1, -1), np.zeros(1), -np.inf)


@dataclass(frozen=True)
class Innovations:
    """All D x M pairs of a frame, linearised at the prediction; whitened, so that detection noise is the identity."""

    residual: Array  # (D, M, m)
    jacobian: Array  # (D, M, m, n) by robot and all near objects
    covariance: Array  # (n, n)

    @classmethod
    def of(cls, prediction: Prediction, pairs: PairDensities) -> "Innovations":
        """Innovations of all pairs of one parent."""
        layout, known = prediction.predicted.layout, len(prediction.near)
        covariance = prediction.predicted.covariance[0]
        part = pairs.part
        jacobian = np.zeros((*part.residual.shape, len(covariance)))
        jacobian[..., layout.block(0)] = part.jacobian_robot
        for column in range(known):
            jacobian[:, column, :, layout.block(1 + column)] = part.jacobian_object[:, column]
        return cls(part.residual, jacobian, covariance)

    def distance_squared(self, pairs: list[tuple[int, int]]) -> float:
        """Squared Mahalanobis distance of all ``pairs`` (detection, object) together."""
        rows, columns = zip(*pairs, strict=True)
        residual = self.residual[rows, columns].ravel()
        jacobian = self.jacobian[rows, columns].reshape(len(residual), -1)
        spread = jacobian @ self.covariance @ jacobian.T + np.eye(len(residual))
        return float(residual @ np.linalg.solve(spread, residual))


@dataclass
class _Search:
    """The best assignment so far: most pairs, and of as many the closest."""

    best: Index
    num_pairs: int = 0
    distance: float = np.inf
    nodes: int = 0
    pairs: list[tuple[int, int]] = field(default_factory=list)


def branch_and_bound(innovations: Innovations) -> Index:
    """(D,) object of every detection, -1 for none."""
    count, known, size = innovations.residual.shape
    limits = chi2.ppf(CONFIDENCE, size * np.arange(count + 1))
    alone = np.array([[innovations.distance_squared([(d, o)]) for o in range(known)] for d in range(count)])
    fitting = [[int(o) for o in np.argsort(row) if row[o] <= limits[1]] for row in alone]
    search = _Search(np.full(count, -1))
    _descend(innovations, fitting, limits, search, 0, 0.0)
    return search.best


def _descend(
    innovations: Innovations, fitting: list[list[int]], limits: Array, search: _Search, level: int, distance: float
) -> None:
    """Pair the detections from ``level`` on; branches that cannot come to as many pairs as the best are cut."""
    search.nodes += 1
    if level == len(fitting):
        if (len(search.pairs), -distance) > (search.num_pairs, -search.distance):
            search.num_pairs, search.distance = len(search.pairs), distance
            search.best = np.full(len(fitting), -1)
            for detection, known in search.pairs:
                search.best[detection] = known
        return
    taken = {known for _, known in search.pairs}
    for known in fitting[level]:
        if known in taken or search.nodes > MOST_NODES:
            continue
        search.pairs.append((level, known))
        joint = innovations.distance_squared(search.pairs)
        if joint <= limits[len(search.pairs)]:
            _descend(innovations, fitting, limits, search, level + 1, joint)
        search.pairs.pop()
    left = len(fitting) - level - 1
    if len(search.pairs) + left >= search.num_pairs:
        _descend(innovations, fitting, limits, search, level + 1, distance)
