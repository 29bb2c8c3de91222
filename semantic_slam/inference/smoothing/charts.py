"""The charts in which iSAM2 has robots and objects: steps from where their variables began, which it never moves.

A step is along the axes of where it began, and its turn is by itself: what moves without turning is linear in steps,
however far, and where an object is does not depend on its heading, which nothing may measure. iSAM2 solves for the
steps; where they lead is told here. What a measurement says at an estimate that has moved and turned is told in the
same charts, exactly to first order: no other factor has to be made anew with it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import gtsam
import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.inference.states.keys import is_object, is_robot, is_vector, number_of, object_key, robot_key
from semantic_slam.inference.states.spaces import Spaces
from semantic_slam.inference.states.state_space import StateSpace


class Variables(NamedTuple):
    """n estimated states of s numbers, and where they are in charts of d dimensions."""

    states: Array  # (n, s)
    steps: Array  # (n, d)
    slopes: Array  # (n, d, d) changes in the tangent spaces at the states by changes of the steps

    def take(self, rows: Index) -> "Variables":
        """Some of them, any number of times."""
        return Variables(self.states[rows], self.steps[rows], self.slopes[rows])

    def joined(self, others: "Variables") -> "Variables":
        """These, and then ``others``."""
        return Variables(*(np.concatenate(pair) for pair in zip(self, others, strict=True)))


@dataclass(frozen=True, kw_only=True)
class Located:
    """Where some robots and objects are estimated to be."""

    robot_rows: Index  # (T,) ascending; row 0 is before the first keyframe
    robots: Variables  # T
    object_ids: Index  # (O,) ascending
    objects: Variables  # O

    def robots_of(self, rows: Index) -> Variables:
        """Robots by their rows (B,)."""
        return self.robots.take(np.searchsorted(self.robot_rows, rows))

    def objects_of(self, ids: Index) -> Variables:
        """Objects by their ids (B,)."""
        return self.objects.take(np.searchsorted(self.object_ids, ids))

    def of(self, key: int) -> Variables:
        """A robot or an object by its GTSAM key."""
        number = np.array([number_of(key)])
        return self.robots_of(number) if is_robot(key) else self.objects_of(number)

    def with_new(self, charts: "Charts") -> "Located":
        """With those that ``charts`` have besides, where they begin."""
        robots, objects = len(self.robots.states), len(self.objects.states)
        new_robots, new_objects = charts.robots[robots:], charts.objects[objects:]
        layout = charts.spaces.layout
        return Located(
            robot_rows=np.arange(len(charts.robots)),
            robots=self.robots.joined(_begun(new_robots, layout.robot)),
            object_ids=charts.object_ids,
            objects=self.objects.joined(_begun(new_objects, layout.landmark)),
        )


@dataclass(frozen=True, kw_only=True)
class Charts:
    """The points of T robots and O objects about which their charts are, and those of biases of odometry."""

    spaces: Spaces
    robots: Array  # (T, s) the first before the first keyframe
    object_ids: Index  # (O,) ascending
    objects: Array  # (O, s)
    vectors: Mapping[int, Array]  # GTSAM key -> where the bias began

    @classmethod
    def of(cls, spaces: Spaces, values: gtsam.Values) -> "Charts":
        """Charts about the ``values``."""
        states, keys = spaces.states(values), list(values.keys())
        ids = np.array([number_of(key) for key in keys if is_object(key)], dtype=int)
        return cls(
            spaces=spaces,
            robots=states[len(ids) :, : spaces.storage.robot],
            object_ids=ids,
            objects=states[: len(ids), : spaces.storage.landmark],
            vectors={key: values.atVector(key) for key in keys if is_vector(key)},
        )

    def extended(self, values: gtsam.Values) -> "Charts":
        """The charts with those of new variables, about their ``values``."""
        keys, spaces = list(values.keys()), self.spaces
        objects = [key for key in keys if is_object(key)]
        robots = [spaces.robot.state(values, key) for key in keys if is_robot(key)]
        started = [spaces.landmark.state(values, key) for key in objects]
        return replace(
            self,
            robots=np.concatenate([self.robots, np.reshape(robots, (-1, spaces.storage.robot))]),
            object_ids=np.append(self.object_ids, np.array([number_of(key) for key in objects], dtype=int)),
            objects=np.concatenate([self.objects, np.reshape(started, (-1, spaces.storage.landmark))]),
            vectors={**self.vectors, **{key: values.atVector(key) for key in keys if is_vector(key)}},
        )

    def located(self, steps: Array) -> Located:
        """All of them after (n,) steps, those of objects and then of robots last."""
        spaces, split = self.spaces, len(steps) - self.robots.shape[0] * self.spaces.layout.robot
        begin = split - self.objects.shape[0] * spaces.layout.landmark
        by_object = steps[begin:split].reshape(-1, spaces.layout.landmark)
        return Located(
            robot_rows=np.arange(len(self.robots)),
            robots=_moved(spaces.robot, self.robots, steps[split:].reshape(-1, spaces.layout.robot)),
            object_ids=self.object_ids,
            objects=_moved(spaces.landmark, self.objects, by_object),
        )

    def begun(self) -> Located:
        """All of them where their charts begin."""
        nothing = replace(self, robots=self.robots[:0], object_ids=self.object_ids[:0], objects=self.objects[:0])
        return nothing.located(np.zeros(0)).with_new(self)

    def values(self, at: Located, others: gtsam.Values) -> gtsam.Values:
        """Where robots and objects are, and ``others`` as they are there."""
        values = gtsam.Values(others)
        kinds = (at.robots, robot_key, at.robot_rows - 1), (at.objects, object_key, at.object_ids)
        for variables, key_of, numbers in kinds:
            for number, state in zip(numbers.tolist(), variables.states, strict=True):
                values.erase(key_of(number))
                self.spaces.of(key_of(number)).insert(values, key_of(number), state)
        return values

    def points(self, keys: Sequence[int]) -> gtsam.Values:
        """About which the charts of some robots and objects are."""
        values = gtsam.Values()
        for key in keys:
            number = number_of(key)
            point = self.robots[number] if is_robot(key) else self.objects[np.searchsorted(self.object_ids, number)]
            self.spaces.of(key).insert(values, key, point)
        return values


def _begun(points: Array, size: int) -> Variables:
    """Variables of ``size`` dimensions where their charts begin, at points (n, s)."""
    return Variables(points, np.zeros((len(points), size)), np.tile(np.eye(size), (len(points), 1, 1)))


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
