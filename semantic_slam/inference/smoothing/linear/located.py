"""Estimates of robots and objects given as steps from the base points of their charts (retraction and its Jacobian)."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.inference.states.keys import is_robot, is_vector, number_of
from semantic_slam.inference.states.kinds.state_space import StateSpace
from semantic_slam.inference.states.layout import Layout


@dataclass(frozen=True)
class Stepped:
    """n variables of one kind as steps from base points; poses are x, y, yaw, and positions x, y."""

    space: StateSpace
    points: Array  # (n, s)
    steps: Array  # (n, d)

    @classmethod
    def joined(cls, parts: Sequence["Stepped"]) -> "Stepped":
        """The variables of several parts, all of one kind."""
        steps = np.concatenate([part.steps for part in parts])
        return cls(parts[0].space, np.concatenate([part.points for part in parts]), steps)

    @property
    def begun(self) -> "Stepped":
        """The variables at their base points."""
        return Stepped(self.space, self.points, np.zeros(self.steps.shape))

    def take(self, rows: Index) -> "Stepped":
        """The variables in some rows, which may repeat."""
        return Stepped(self.space, self.points[rows], self.steps[rows])

    @cached_property
    def states(self) -> Array:
        """(n, s) states after the steps."""
        points, steps = self.points, self.steps
        if self.space.heading is None:
            return points + steps
        cos, sin, states = np.cos(points[:, 2]), np.sin(points[:, 2]), np.empty(points.shape)
        states[:, 0] = points[:, 0] + (cos * steps[:, 0] - sin * steps[:, 1])
        states[:, 1] = points[:, 1] + (sin * steps[:, 0] + cos * steps[:, 1])
        states[:, 2] = wrap_angle(points[:, 2] + steps[:, 2])
        return states

    @cached_property
    def slopes(self) -> Array:
        """(n, d, d) Jacobian of tangent vectors at the states by the steps."""
        slopes = np.zeros((*self.steps.shape, self.steps.shape[1]))
        if self.space.heading is None:
            slopes[:] = np.eye(self.steps.shape[1])
            return slopes
        slopes[:, 0, 0] = slopes[:, 1, 1] = np.cos(self.steps[:, 2])
        slopes[:, 0, 1] = np.sin(self.steps[:, 2])
        slopes[:, 1, 0] = -slopes[:, 0, 1]
        slopes[:, 2, 2] = 1.0
        return slopes

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

    def robots_of(self, rows: Index) -> Stepped:
        """Robots in some rows (B,)."""
        return self.robots.take(rows)

    def objects_of(self, ids: Index) -> Stepped:
        """Objects with some ids (B,)."""
        return self.objects.take(np.searchsorted(self.object_ids, ids))

    @property
    def largest_turn(self) -> float:
        """Largest rotation [rad] of a robot in its chart; 0 where robots have no heading."""
        steps = self.robots.steps
        return float(np.abs(steps[:, 2]).max(initial=0.0)) if steps.shape[1] > 2 else 0.0

    def of(self, key: int) -> Stepped:
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
