"""Joint compatibility of many object pairs: which are one object each, in closed form in the joint Gaussian of places.

A single pair says little: after a long drive much is near. But one transform of a stretch of the drive makes many pairs
coincide at once, or none. So pairs are assumed in turn, and to the most promising ones others are added greedily while
they gain: the least ambiguous first, each conditioned on those before.
"""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index

GATE = 16.0
"""Squared Mahalanobis distance between two objects beyond which they are not merged."""
EXACT_M2 = 1e-6
"""Variance [m^2] of merged objects about each other: keeps joint Gaussians nonsingular."""
MOST_ASSUMED, MOST_FOLLOWED = 2000, 16
"""Number of pairs, likeliest alone first, that are assumed in turn, and how many of these, those with which the others
gain most, are followed up: a return shows in few pairs, and not every one of them leads to the others."""
MOST_RIVALS = 60
"""Number of pairs, likeliest first, that are compared for ambiguity."""


@dataclass(frozen=True)
class JointPairs:
    """N places with their joint Gaussian, and n pairs of them that may be one object each."""

    places: Array  # (N, 2) metres, in map
    covariance: Array  # (2 N, 2 N)
    pairs: Index  # (n, 2) older and younger
    log_new: float  # log intensity of new objects [1/m^2], one fewer per join

    def best(self) -> tuple[float, Index]:
        """Log evidence ratio of the best set of pairs (rows) to none, and the set."""
        near, best = self._gains(), (0.0, np.zeros(0, dtype=int))
        rows = np.argsort(-near.gain, kind="stable")[:MOST_ASSUMED]
        rows = rows[np.isfinite(near.gain[rows])]
        promise = np.array([near.gain[row] + self._promise(near, int(row)) for row in rows])
        for row in rows[np.argsort(-promise, kind="stable")[:MOST_FOLLOWED]].tolist():
            found = self._followed(row)
            if found[0] > best[0]:
                best = found
        return best

    def _gains(self) -> "_Gains":
        """Log gain of every pair by itself."""
        older, younger = self.pairs.T
        blocks = self.covariance.reshape(len(self.places), 2, len(self.places), 2).transpose(0, 2, 1, 3)
        cross = blocks[older, younger]
        spread = blocks[older, older] + blocks[younger, younger] - cross - np.swapaxes(cross, 1, 2)
        return _Gains.of(self.places[younger] - self.places[older], spread, self.log_new)

    def _promise(self, near: "_Gains", row: int) -> float:
        """What the other pairs gain given one pair alone, at most one for each younger object."""
        older, younger = self.pairs.T
        by_pair = self._offset_covariance(*self.pairs[row])
        cross = by_pair[younger] - by_pair[older]
        gain = cross @ np.linalg.inv(near.spread[row])
        offset = near.offset - gain @ near.offset[row]
        given = _Gains.of(offset, near.spread - gain @ np.swapaxes(cross, 1, 2), self.log_new)
        others = (older != self.pairs[row, 0]) & (younger != self.pairs[row, 1]) & (given.gain > 0.0)
        best = np.zeros(len(self.places))
        np.maximum.at(best, younger[others], given.gain[others])
        return float(best.sum())

    def _offset_covariance(self, older: int, younger: int) -> Array:
        """(N, 2, 2) covariance of all places with the offset of a pair."""
        count = len(self.places)
        columns = self.covariance.reshape(count, 2, count, 2)
        return np.asarray(columns[:, :, younger] - columns[:, :, older])

    def _followed(self, row: int) -> tuple[float, Index]:
        """Total gain of a pair and of all pairs that join it one after another, and the rows of all."""
        now, free, total = self, np.ones(len(self.pairs), dtype=bool), 0.0
        chosen: list[int] = []
        while row >= 0:
            total += float(now._gains().gain[row])
            chosen.append(row)
            now = now._given(row)
            free &= (self.pairs[:, 0] != self.pairs[row, 0]) & (self.pairs[:, 1] != self.pairs[row, 1])
            row = now._clearest(free)
        return total, np.array(chosen, dtype=int)

    def _given(self, row: int) -> "JointPairs":
        """The joint Gaussian conditioned on a pair being one object."""
        older, younger = self.pairs[row]
        cross = self._offset_covariance(older, younger)
        spread = cross[younger] - cross[older] + EXACT_M2 * np.eye(2)
        flat = cross.reshape(-1, 2)
        gain = np.linalg.solve(spread, flat.T).T
        places = self.places - (gain @ (self.places[younger] - self.places[older])).reshape(-1, 2)
        return JointPairs(places, self.covariance - gain @ flat.T, self.pairs, self.log_new)

    def _clearest(self, free: Flags) -> int:
        """Row of the least ambiguous pair: largest gain beyond any rival with an object in common; -1: none gains."""
        gain = np.where(free, self._gains().gain, -np.inf)
        rows = np.argsort(-gain, kind="stable")[:MOST_RIVALS]
        rows = rows[gain[rows] > 0.0]
        if not len(rows):
            return -1
        rivals = (self.pairs[rows, None, :] == self.pairs[None, rows, :]).any(axis=2)
        np.fill_diagonal(rivals, False)
        beyond = gain[rows] - np.where(rivals, gain[rows], 0.0).max(axis=1)
        return int(rows[int(np.argmax(beyond))])


@dataclass(frozen=True)
class _Gains:
    """Offsets of n pairs, older to younger, and the log gain of merging each by its place; -inf outside the gate."""

    offset: Array  # (n, 2)
    spread: Array  # (n, 2, 2)
    gain: Array  # (n,)

    @classmethod
    def of(cls, offset: Array, spread: Array, log_new: float) -> "_Gains":
        spread = 0.5 * (spread + np.swapaxes(spread, 1, 2)) + EXACT_M2 * np.eye(2)
        a, b, c = spread[:, 0, 0], spread[:, 0, 1], spread[:, 1, 1]
        determinant = np.maximum(a * c - b * b, EXACT_M2**2)
        x, y = offset.T
        squared = (c * x * x - 2.0 * b * x * y + a * y * y) / determinant
        gain = -0.5 * squared - 0.5 * np.log(determinant) - np.log(2.0 * np.pi) - log_new
        return cls(offset, spread, np.where(squared < GATE, gain, -np.inf))
