"""Constellation matching for global localisation: rigid motions that align a robot's own map with the given map.

Two objects and two of the map at the same distance from each other give a motion; other objects then support it or not.
The best motions are weighed with the joint Gaussian of the objects, which are matched one by one. This only proposes:
the replay of a proposed history determines its weight.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.pose import wrap_angle

LEAST_BASE_M = 0.8
"""Distance between two objects from which on they determine a heading."""
LARGEST_MISFIT = 3.0
"""Largest difference between the distances of two pairs, in standard deviations."""
MOST_MOTIONS = 6
"""Number of motions that are weighed with the joint Gaussian."""
APART = np.array([0.5, 0.5, 0.15])
"""Least difference in x, y [m] or yaw [rad] between two motions."""
LARGEST_GATE_M = 4.0
"""Largest distance at which an uncertain object may match one of the map."""
NEIGHBOUR_M = 1.0
"""Distance on the map within which objects may be confused once the motion is known."""
STEPS = 2
"""Gauss-Newton steps for a motion."""


@dataclass(frozen=True)
class Places:
    """n positions [m] with their joint covariance."""

    points: Array  # (n, 2)
    covariance: Array  # (2 n, 2 n)

    def block(self, one: int, other: int) -> Array:
        """(2, 2) covariance of two of them."""
        return self.covariance[2 * one : 2 * one + 2, 2 * other : 2 * other + 2]

    def __len__(self) -> int:
        return len(self.points)


@dataclass(frozen=True)
class Fit:
    """A motion that aligns objects with the map, and the matches."""

    T_map_own: Array  # (3,)
    names: dict[int, int]  # object -> map object, one to one within each stretch
    points: Array  # (n, 2) positions of all objects then, in their own frame
    log_gain: float  # log evidence relative to that many unmapped objects, without misses


@dataclass(frozen=True, kw_only=True)
class Fitting:
    """The matching problem: objects in their own frame, a map, and priors."""

    own: Places
    map_points: Array  # (M, 2)
    map_covariances: Array  # (M, 2, 2)
    log_new: float  # log density of an object that is not on the map, per square metre
    log_prior: Callable[[Array], Array]  # log density of motions (..., 3)
    stretches: Index  # (n,) stretch of the drive; objects of two stretches may be one

    def best(self, count: int) -> list[Fit]:
        """At most ``count`` fits of three or more objects, the best ones first."""
        motions, scores = self._motions()
        chosen: list[Array] = []
        for row in np.argsort(-scores, kind="stable").tolist():
            if all(_differ(motions[row], other) for other in chosen):
                chosen.append(motions[row])
            if len(chosen) == MOST_MOTIONS:
                break
        fits = [fit for motion in chosen for fit in self._fits(motion)]
        unlike: dict[tuple[tuple[int, int], ...], Fit] = {}
        for fit in sorted(fits, key=lambda own: -own.log_gain):
            unlike.setdefault(tuple(sorted(fit.names.items())), fit)
        return list(unlike.values())[:count]

    def _motions(self) -> tuple[Array, Array]:
        """(K, 3) motions from pairs of objects, and a score of how well each fits the others."""
        found = [(np.zeros((0, 3)), np.zeros(0))]
        found += [self._of_pair(one, other) for one, other in combinations(range(len(self.own)), 2)]
        motions, scores = zip(*found, strict=True)
        return np.concatenate(motions), np.concatenate(scores)

    def _of_pair(self, one: int, other: int) -> tuple[Array, Array]:
        """Motions that align two objects with two of the map, and their scores."""
        base = self.own.points[other] - self.own.points[one]
        length = float(np.hypot(*base))
        if length < LEAST_BASE_M:
            return np.zeros((0, 3)), np.zeros(0)
        along = base / length
        spread = self.own.block(one, one) + self.own.block(other, other)
        variance = along @ (spread - self.own.block(one, other) - self.own.block(other, one)) @ along
        bases = self.map_points[None] - self.map_points[:, None]  # (M, M, 2) from the first to the second
        lengths = np.hypot(bases[..., 0], bases[..., 1])
        noise = np.trace(self.map_covariances, axis1=1, axis2=2)
        sigmas = np.sqrt(variance + 0.5 * (noise[:, None] + noise))
        first, second = np.nonzero((np.abs(lengths - length) < LARGEST_MISFIT * sigmas) & (lengths > 0.0))
        turn = np.arctan2(bases[first, second, 1], bases[first, second, 0]) - np.arctan2(base[1], base[0])
        middle = 0.5 * (self.own.points[one] + self.own.points[other])
        there = 0.5 * (self.map_points[first] + self.map_points[second])
        motions = np.column_stack([there - _turned(turn, middle[None]), wrap_angle(turn)])
        return motions, self._scores(motions, (one, other), lengths[first, second] - length, along)

    def _scores(self, motions: Array, pair: tuple[int, int], stretch: Array, along: Array) -> Array:
        """(K,) rough log gains of motions, given that the ``pair`` coincides with its map objects."""
        rows = np.concatenate([np.arange(2 * n, 2 * n + 2) for n in pair])
        among = self.own.covariance[np.ix_(rows, rows)] + 1e-6 * np.eye(4)
        gain = np.linalg.solve(among, self.own.covariance[rows]).T  # (2 n, 4)
        shift = 0.5 * np.concatenate([-along, along])
        places = self.own.points[None] + stretch[:, None, None] * (gain @ shift).reshape(-1, 2)
        after = self.own.covariance - gain @ self.own.covariance[rows]
        blocks = np.array([after[2 * n : 2 * n + 2, 2 * n : 2 * n + 2] for n in range(len(self.own))])
        variance = 0.5 * np.trace(blocks, axis1=1, axis2=2)[:, None]
        variance = variance + 0.5 * np.trace(self.map_covariances, axis1=1, axis2=2) + 1e-4  # (n, M)
        moved = motions[:, None, :2] + _turned(motions[:, None, 2], places)
        away = [moved[:, :, None, axis] - self.map_points[:, axis] for axis in (0, 1)]
        squared = away[0] ** 2 + away[1] ** 2  # numpy is slow to sum over an axis of two
        density = (-0.5 / variance) * squared - np.log(2.0 * np.pi * variance)
        gains = np.maximum(density.max(axis=-1) - self.log_new, 0.0)
        gains[:, list(pair)] = 0.0
        return np.asarray(gains.sum(axis=1) + self.log_prior(motions))

    def _fits(self, motion: Array) -> list[Fit]:
        """The fit by greedy matching, and those that differ from it in one match or two."""
        names = self._named(motion)
        if len(names) < 3:
            return []
        best = self.weighed(motion, names)
        while True:
            others = [self.weighed(best.T_map_own, changed) for changed in self._changed(best.names)]
            better = max(others, key=lambda own: own.log_gain, default=best)
            if better.log_gain <= best.log_gain + 1e-6:
                break
            best = better
        close = [own for own in others if own.log_gain > best.log_gain - UNLIKELY]
        return [best, *close]

    def _named(self, motion: Array) -> dict[int, int]:
        """Matches made one by one, each the one that gains most given those before."""
        names: dict[int, int] = {}
        log_gain, points = -np.inf, self.own.points
        while True:
            moved = motion[:2] + _turned(motion[2], points)
            away = np.linalg.norm(moved[:, None] - self.map_points, axis=-1)
            free = [n for n in range(len(self.own)) if n not in names]
            taken = self._taken(names)
            near = [(n, int(m)) for n in free for m in np.flatnonzero(away[n] < self._gates[n])]
            pairs = [(n, m) for n, m in near if (self.stretches[n], m) not in taken]
            pairs = sorted(pairs, key=lambda own: away[own])[:4]
            found = [self.weighed(motion, names | {n: m}) for n, m in pairs]
            best = max(found, key=lambda own: own.log_gain, default=None)
            if best is None or (best.log_gain <= log_gain and len(names) >= 3):
                return names
            names, motion, log_gain, points = best.names, best.T_map_own, best.log_gain, best.points

    def _changed(self, names: dict[int, int]) -> list[dict[int, int]]:
        """Matches with one object matched otherwise or unmatched, or with two objects exchanged."""
        found: list[dict[int, int]] = []
        taken = self._taken(names)
        for n, m in names.items():
            if len(names) > 3:
                found.append({k: own for k, own in names.items() if k != n})
            for other in self._neighbours(m):
                holder = taken.get((self.stretches[n], other))
                if holder is None:
                    found.append(names | {n: other})
                elif holder > n:
                    found.append(names | {n: other, holder: m})
        return found

    def _taken(self, names: dict[int, int]) -> dict[tuple[int, int], int]:
        """(stretch, map object) -> the object matched to it."""
        return {(int(self.stretches[n]), m): n for n, m in names.items()}

    @cached_property
    def _gates(self) -> Array:
        """(n,) largest distance [m] from an object to a match."""
        variances = np.diagonal(self.own.covariance).reshape(-1, 2).mean(axis=1)
        return np.asarray(np.maximum(NEIGHBOUR_M, np.minimum(np.sqrt(variances), LARGEST_GATE_M)))

    def _neighbours(self, number: int) -> list[int]:
        away = np.linalg.norm(self.map_points - self.map_points[number], axis=1)
        return [int(m) for m in np.flatnonzero(away < NEIGHBOUR_M) if int(m) != number]

    def weighed(self, motion: Array, names: dict[int, int]) -> Fit:
        """The best motion for these matches, and their log gain with the motion integrated out."""
        order, chosen = list(names), list(names.values())
        rows = np.concatenate([np.arange(2 * n, 2 * n + 2) for n in order])
        points, among = self.own.points[order], self.own.covariance[np.ix_(rows, rows)]
        for _ in range(STEPS):
            turned = _turned(motion[2], points)
            residual = (motion[:2] + turned - self.map_points[chosen]).ravel()
            slope = np.zeros((len(rows), 3))
            slope[0::2, 0] = slope[1::2, 1] = 1.0
            slope[0::2, 2], slope[1::2, 2] = -turned[:, 1], turned[:, 0]
            covariance = self._turned_covariance(motion[2], among, chosen)
            weighted = np.linalg.solve(covariance, np.column_stack([slope, residual]))
            information = slope.T @ weighted[:, :3] + RIDGE
            step = np.linalg.solve(information, slope.T @ weighted[:, 3])
            motion = motion - step
        left = residual - slope @ step
        pull = np.linalg.solve(covariance, left)
        squared = float(left @ pull)
        back = (pull.reshape(-1, 2) @ _rotation(motion[2])).ravel()  # in the objects' own frame
        after = self.own.points - (self.own.covariance[:, rows] @ back).reshape(-1, 2)
        log_gain = -0.5 * squared - 0.5 * float(np.linalg.slogdet(2.0 * np.pi * covariance)[1])
        log_gain -= 0.5 * float(np.linalg.slogdet(information / (2.0 * np.pi))[1])
        motion = np.append(motion[:2], wrap_angle(motion[2]))
        log_gain += float(self.log_prior(motion)) - self.log_new * len(order)
        return Fit(motion, dict(names), after, log_gain)

    def _turned_covariance(self, turn: float, among: Array, chosen: Sequence[int]) -> Array:
        count, rotation, names = len(chosen), _rotation(turn), np.asarray(chosen)
        blocks = rotation @ among.reshape(count, 2, count, 2).transpose(0, 2, 1, 3) @ rotation.T  # (n, n, 2, 2)
        same = names[:, None] == names  # objects matched to one map object share its error
        blocks = blocks + same[..., None, None] * self.map_covariances[names]
        covariance = blocks.transpose(0, 2, 1, 3).reshape(2 * count, 2 * count)
        return np.asarray(covariance + 1e-6 * np.eye(len(covariance)))


UNLIKELY = 5.0
"""Nats behind a fit beyond which a variant of it is dropped."""
RIDGE = np.diag([1e-3, 1e-3, 1e-3])
"""Prior information of a motion, which a single object leaves undetermined: some thirty metres and radians."""


def _differ(one: Array, other: Array) -> bool:
    """Whether two motions (3,) are distinct."""
    offset = one - other
    offset[2] = wrap_angle(offset[2])
    return bool((np.abs(offset) > APART).any())


def _rotation(turn: float) -> Array:
    return np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])


def _turned(turn: Array | float, points: Array) -> Array:
    """(..., 2) points turned by (...,) radians."""
    sine, cosine = np.sin(turn), np.cos(turn)
    x, y = points[..., 0], points[..., 1]
    return np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=-1)


def positions(states: Array, tangent_covariance: Array) -> Places:
    """Places of n poses (n, 3) from the (3 n, 3 n) covariance of perturbations in their own frames."""
    count = len(states)
    turns = np.zeros((2 * count, 3 * count))
    for n, state in enumerate(states):
        turns[2 * n : 2 * n + 2, 3 * n : 3 * n + 2] = _rotation(float(state[2]))
    return Places(states[:, :2].copy(), turns @ tangent_covariance @ turns.T)
