"""The charts in which iSAM2 has robots and objects: steps from where their variables began, which it never moves.

A step is along the axes of where it began, and its turn is by itself: what moves without turning is linear in steps,
however far, and where an object is does not depend on its heading, which nothing may measure. iSAM2 solves for the
steps; where they lead is told here. What a measurement says at an estimate that has moved and turned is told in the
same charts, exactly to first order: no other factor has to be made anew with it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import gtsam
import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.inference.smoothing.linear.located import Located, Stepped
from semantic_slam.inference.states.keys import is_object, is_robot, is_vector, number_of, object_key, robot_key
from semantic_slam.inference.states.kinds.state_space import StateSpace
from semantic_slam.inference.states.spaces import Spaces


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
        last, point = at.robots_of(np.array([-1])).states[0], self.robots[-1]
        charts = replace(
            self,
            robots=np.concatenate([self.robots, _carried(spaces.robot, robot[None], last, point)]),
            object_ids=np.append(self.object_ids, np.array([number_of(key) for key in objects], dtype=int)),
            objects=np.concatenate([self.objects, _carried(spaces.landmark, started, last, point)]),
            vectors={**self.vectors, **{key: values.atVector(key) for key in keys if is_vector(key)}},
        )
        located = Located(
            robots=at.robots.with_states(charts.robots[-1:], robot[None]),
            object_ids=charts.object_ids,
            objects=at.objects.with_states(charts.objects[len(self.objects) :], started),
        )
        return charts, located, _changed(values, charts.points([key for key in keys if not is_vector(key)]))

    def located(self, steps: Array) -> Located:
        """All of them after (n,) steps, those of objects and then of robots last."""
        spaces, split = self.spaces, len(steps) - self.robots.shape[0] * self.spaces.layout.robot
        begin = split - self.objects.shape[0] * spaces.layout.landmark
        by_object = steps[begin:split].reshape(-1, spaces.layout.landmark)
        return self._after(steps[split:].reshape(-1, spaces.layout.robot), by_object)

    def begun(self) -> Located:
        """All of them where their charts begin."""
        layout = self.spaces.layout
        return self._after(np.zeros((len(self.robots), layout.robot)), np.zeros((len(self.objects), layout.landmark)))

    def _after(self, by_robot: Array, by_object: Array) -> Located:
        return Located(
            robots=Stepped(self.spaces.robot, self.robots, by_robot),
            object_ids=self.object_ids,
            objects=Stepped(self.spaces.landmark, self.objects, by_object),
        )

    def values(self, at: Located, others: gtsam.Values) -> gtsam.Values:
        """Where robots and objects are, and ``others`` as they are there."""
        found = gtsam.Values()
        for number, state in zip(self.object_ids.tolist(), at.objects.states, strict=True):
            self.spaces.landmark.insert(found, object_key(number), state)
        for row, state in enumerate(at.robots.states):
            self.spaces.robot.insert(found, robot_key(row - 1), state)
        return _changed(others, found)

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


def _changed(values: gtsam.Values, places: gtsam.Values) -> gtsam.Values:
    """Values in which robots and objects are at other places."""
    changed = gtsam.Values(values)
    changed.update(places)
    return changed
