"""Estimates of robots and objects given as steps from the base points of their charts (retraction and its Jacobian)."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.inference.states.keys import is_robot, is_vector, number_of
from semantic_slam.inference.states.kinds.state_space import StateSpace
from semantic_slam.inference.states.layout import Layout


class Variables(NamedTuple):
    """n estimated states of s numbers, with their coordinates in charts of d dimensions."""

    states: Array  # (n, s)
    steps: Array  # (n, d)
    slopes: Array  # (n, d, d) Jacobian of tangent vectors at the states by the steps


@dataclass(frozen=True)
class Stepped:
    """n variables of one kind as steps from base points; states are computed on demand."""

    space: StateSpace
    points: Array  # (n, s)
    steps: Array  # (n, d)

    def take(self, rows: Index) -> Variables:
        """The variables in some rows, which may repeat."""
        return _moved(self.space, self.points[rows], self.steps[rows])

    @property
    def states(self) -> Array:
        """(n, s) states of all of them."""
        return _moved(self.space, self.points, self.steps).states

    def with_states(self, points: Array, states: Array) -> "Stepped":
        """With others appended, at ``states`` (m, s) and with base ``points`` (m, s)."""
        steps = np.concatenate([self.steps, _steps(self.space, points, states)])
        return Stepped(self.space, np.concatenate([self.points, points]), steps)


@dataclass(frozen=True, kw_only=True)
class Located:
    """Estimates of robots and objects in their charts."""

    robots: Stepped  # T; the first precedes the first keyframe
    object_ids: Index  # (O,) ascending
    objects: Stepped  # O

    def robots_of(self, rows: Index) -> Variables:
        """Robots in some rows (B,)."""
        return self.robots.take(rows)

    def objects_of(self, ids: Index) -> Variables:
        """Objects with some ids (B,)."""
        return self.objects.take(np.searchsorted(self.object_ids, ids))

    @property
    def largest_turn(self) -> float:
        """Largest rotation [rad] of a robot in its chart; 0 where robots have no heading."""
        steps = self.robots.steps
        return float(np.abs(steps[:, 2]).max(initial=0.0)) if steps.shape[1] > 2 else 0.0

    def of(self, key: int) -> Variables:
        """A robot or an object by its GTSAM key."""
        number = np.array([number_of(key)])
        return self.robots_of(number) if is_robot(key) else self.objects_of(number)

    def states(self, keys: Sequence[int], storage: Layout) -> Array:
        """(n, w) states of robots and objects, in the order of ``keys``."""
        numbers, robots = _numbers(tuple(keys))
        found = np.zeros((len(keys), storage.width))
        found[robots, : storage.robot] = self.robots_of(numbers[robots]).states
        found[~robots, : storage.landmark] = self.objects_of(numbers[~robots]).states
        return found

    def covariance(self, parts: Sequence[tuple[int, slice]], in_charts: Array) -> Array:
        """A covariance transformed to the tangent spaces at the estimates; ``parts``: rows of each GTSAM key."""
        slopes = np.eye(len(in_charts))
        for key, own in parts:
            if not is_vector(key):
                slopes[own, own] = self.of(key).slopes[0]
        return np.asarray(slopes @ in_charts @ slopes.T)


@lru_cache(maxsize=1024)
def _numbers(keys: tuple[int, ...]) -> tuple[Index, Flags]:
    """The number of each key, and whether it is a robot's."""
    return np.array([number_of(key) for key in keys]), np.array([is_robot(key) for key in keys])


def _steps(space: StateSpace, points: Array, states: Array) -> Array:
    """(n, d) steps from base points (n, s) to states (n, s)."""
    if space.heading is None:
        return np.asarray(states - points)
    cos, sin = np.cos(points[:, 2]), np.sin(points[:, 2])
    x, y = (states - points)[:, :2].T
    return np.stack([cos * x + sin * y, cos * y - sin * x, wrap_angle(states[:, 2] - points[:, 2])], axis=1)


def _moved(space: StateSpace, points: Array, steps: Array) -> Variables:
    """States after ``steps`` (n, d) from points (n, s); poses are x, y, yaw, and positions x, y."""
    slopes = np.zeros((*steps.shape, steps.shape[1]))
    if space.heading is None:
        slopes[:] = np.eye(steps.shape[1])
        return Variables(points + steps, steps, slopes)
    cos, sin = np.cos(points[:, 2]), np.sin(points[:, 2])
    ahead = cos * steps[:, 0] - sin * steps[:, 1], sin * steps[:, 0] + cos * steps[:, 1]
    states = np.stack(
        [points[:, 0] + ahead[0], points[:, 1] + ahead[1], wrap_angle(points[:, 2] + steps[:, 2])], axis=1
    )
    slopes[:, 0, 0] = slopes[:, 1, 1] = np.cos(steps[:, 2])
    slopes[:, 0, 1] = np.sin(steps[:, 2])
    slopes[:, 1, 0] = -slopes[:, 0, 1]
    slopes[:, 2, 2] = 1.0
    return Variables(states, steps, slopes)
