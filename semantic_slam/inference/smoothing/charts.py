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
from semantic_slam.inference.states.keys import is_object, is_robot, is_vector, number_of
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

    @property
    def largest_turn(self) -> float:
        """Radians by which a robot has turned in its chart, at most; 0 where robots do not turn."""
        steps = self.robots.steps
        return float(np.abs(steps[:, 2]).max(initial=0.0)) if steps.shape[1] > 2 else 0.0

    def of(self, key: int) -> Variables:
        """A robot or an object by its GTSAM key."""
        number = np.array([number_of(key)])
        return self.robots_of(number) if is_robot(key) else self.objects_of(number)


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

    def extended(self, values: gtsam.Values, at: Located) -> tuple["Charts", Located, gtsam.Values]:
        """The charts with those of new variables, where all are estimated to be, and where the new charts begin.

        New variables are estimated at ``values``, the others ``at``. Their charts are to each other, and to the newest
        of those before, as the estimates are: all that is measured of one another holds where charts begin, however far
        the estimate has moved and turned since as a whole. What turns all of the map alike then turns nothing measured.
        """
        keys, spaces = list(values.keys()), self.spaces
        objects = [key for key in keys if is_object(key)]
        (robot,) = (spaces.robot.state(values, key) for key in keys if is_robot(key))
        started = np.reshape([spaces.landmark.state(values, key) for key in objects], (-1, spaces.storage.landmark))
        last, point = at.robots.states[-1], self.robots[-1]
        charts = replace(
            self,
            robots=np.concatenate([self.robots, _carried(spaces.robot, robot[None], last, point)]),
            object_ids=np.append(self.object_ids, np.array([number_of(key) for key in objects], dtype=int)),
            objects=np.concatenate([self.objects, _carried(spaces.landmark, started, last, point)]),
            vectors={**self.vectors, **{key: values.atVector(key) for key in keys if is_vector(key)}},
        )
        located = Located(
            robot_rows=np.arange(len(charts.robots)),
            robots=at.robots.joined(_known(spaces.robot, charts.robots[-1:], robot[None])),
            object_ids=charts.object_ids,
            objects=at.objects.joined(_known(spaces.landmark, charts.objects[len(self.objects) :], started)),
        )
        return charts, located, charts.values(charts.begun(), values, keys)

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
        robots, objects = self.robots, self.objects
        return Located(
            robot_rows=np.arange(len(robots)),
            robots=_known(self.spaces.robot, robots, robots),
            object_ids=self.object_ids,
            objects=_known(self.spaces.landmark, objects, objects),
        )

    def values(self, at: Located, others: gtsam.Values, keys: Sequence[int] | None = None) -> gtsam.Values:
        """Where robots and objects are, all or those of some ``keys``, and ``others`` as they are there."""
        values, every = gtsam.Values(others), others.keys() if keys is None else keys
        for key in every:
            if not is_vector(key):
                values.erase(key)
                self.spaces.of(key).insert(values, key, at.of(key).states[0])
        return values

    def points(self, keys: Sequence[int]) -> gtsam.Values:
        """About which the charts of some robots and objects are."""
        values = gtsam.Values()
        for key in keys:
            number = number_of(key)
            point = self.robots[number] if is_robot(key) else self.objects[np.searchsorted(self.object_ids, number)]
            self.spaces.of(key).insert(values, key, point)
        return values


def _carried(space: StateSpace, states: Array, last: Array, point: Array) -> Array:
    """(n, s) points that are to ``point`` (s,) as states (n, s) are to ``last`` (s,); poses are x, y, yaw."""
    if space.heading is None and len(last) == space.storage_size:
        return states + (point - last)
    turn = point[2] - last[2]
    cos, sin = np.cos(turn), np.sin(turn)
    points, apart = states.copy(), states[:, :2] - last[:2]
    points[:, 0] = point[0] + cos * apart[:, 0] - sin * apart[:, 1]
    points[:, 1] = point[1] + sin * apart[:, 0] + cos * apart[:, 1]
    if space.heading is not None:
        points[:, 2] = wrap_angle(states[:, 2] + turn)
    return points


def _known(space: StateSpace, points: Array, states: Array) -> Variables:
    """Variables at ``states`` (n, s), whose charts begin at points (n, s)."""
    if space.heading is None:
        return _moved(space, points, states - points)
    cos, sin = np.cos(points[:, 2]), np.sin(points[:, 2])
    x, y = (states - points)[:, :2].T
    steps = np.stack([cos * x + sin * y, cos * y - sin * x, wrap_angle(states[:, 2] - points[:, 2])], axis=1)
    return _moved(space, points, steps)


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
