"""The semantic factors of a graph: the measurement and linearisation point of each, and what is added or replaced."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import gtsam
import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Index
from semantic_slam.inference.smoothing.semantic_factors import NO_POINTS, LinearisationPoints, SemanticFactor


@dataclass(frozen=True, kw_only=True)
class FactorTable:
    """The semantic measurements in a graph, with one factor each."""

    measurements: tuple[SemanticFactor, ...] = ()
    indices: tuple[int, ...] = ()  # in iSAM2's list of factors
    points: LinearisationPoints = NO_POINTS  # where linear factors were made
    keys: Index = field(default_factory=lambda: np.zeros((0, 2), dtype=int), compare=False)  # (n, 2 or 3) of variables
    exact: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=bool), compare=False)  # (n,) callbacks

    def __len__(self) -> int:
        return len(self.measurements)

    def added(
        self, measurements: Sequence[SemanticFactor], indices: Sequence[int], points: LinearisationPoints
    ) -> "FactorTable":
        """The table with more factors."""
        if not measurements:
            return self
        keys = keys_of(measurements)
        return FactorTable(
            measurements=(*self.measurements, *measurements),
            indices=(*self.indices, *indices),
            points=LinearisationPoints.joined([self.points, points]),
            keys=np.concatenate([self.keys, keys]) if len(self.keys) else keys,
            exact=np.concatenate([self.exact, np.array([item.exact for item in measurements], dtype=bool)]),
        )

    def replaced(
        self,
        rows: Sequence[int],
        measurements: Sequence[SemanticFactor],
        indices: Sequence[int],
        points: LinearisationPoints,
    ) -> "FactorTable":
        """The table with some factors relinearised."""
        if not rows:
            return self
        all_measurements, all_indices, exact = list(self.measurements), list(self.indices), self.exact.copy()
        for row, item, index in zip(rows, measurements, indices, strict=True):
            all_measurements[row], all_indices[row], exact[row] = item, index, item.exact
        return FactorTable(
            measurements=tuple(all_measurements),
            indices=tuple(all_indices),
            points=self.points.replaced(rows, points),
            keys=self.keys,
            exact=exact,
        )

    def exact_rows(self, descriptor_keys: Collection[int | None]) -> list[int]:
        """Rows of measurements of these descriptors that have exact (callback) factors."""
        rows: list[int] = np.flatnonzero(self.exact).tolist()
        return [row for row in rows if self.measurements[row].descriptor_key in descriptor_keys]

    def linear_rows(self, objects: Collection[int] | None = None) -> Index:
        """Rows of measurements with linear factors, of the objects with some keys or of all."""
        linear = ~self.exact
        if objects is not None and len(linear):
            linear &= np.logical_or.reduce([self.keys[:, 1] == key for key in objects])
        return linear.nonzero()[0]

    def linear(self, rows: Sequence[int]) -> list[SemanticFactor]:
        """Measurements of the ``rows``, marked for linear factors."""
        measurements = [self.measurements[row] for row in rows]
        return [replace(item, exact=False) if item.exact else item for item in measurements]

    def without(self, graph: gtsam.NonlinearFactorGraph, num_factors: int | None = None) -> gtsam.NonlinearFactorGraph:
        """All factors of ``graph`` but the semantic ones; of its first ``num_factors`` where given."""
        graph = gtsam.NonlinearFactorGraph(graph)
        semantic, kept = set(self.indices), gtsam.NonlinearFactorGraph()
        for i in range(graph.size() if num_factors is None else num_factors):
            if i not in semantic and graph.exists(i):
                kept.add(graph.at(i))
        return kept


NO_FACTORS = FactorTable()


def keys_of(measurements: Sequence[SemanticFactor]) -> Index:
    """(n, 2) of robots and objects, or (n, 3) with descriptors."""
    return np.array([item.keys for item in measurements], dtype=int).reshape(len(measurements), -1)


@dataclass(frozen=True)
class AddedFactors:
    """New semantic measurements, their factors and linearisation points."""

    measurements: Sequence[SemanticFactor]
    factors: Sequence[Any]
    points: LinearisationPoints


@dataclass(frozen=True)
class RelinearisedFactors:
    """Semantic measurements whose factors are replaced by linear ones, and the new linearisation points."""

    rows: Sequence[int]
    factors: Sequence[Any]
    points: LinearisationPoints


NONE_ADDED, NONE_RELINEARISED = AddedFactors((), (), NO_POINTS), RelinearisedFactors((), (), NO_POINTS)
