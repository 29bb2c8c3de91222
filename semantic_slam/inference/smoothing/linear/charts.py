"""Charts: the fixed local coordinates in which iSAM2 holds robots and objects, about base points that it never moves.

The coordinates of a variable, its steps, are along the axes of its base point, with the heading as a coordinate of its
own: translation without rotation is linear in them over any distance, and an object's position does not depend on its
heading, which nothing may measure. iSAM2 solves for the steps; this module retracts them to states. A measurement at an
estimate that has moved and turned is expressed in the same charts, exactly to first order: no other factor has to be
relinearised with it.
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
    """The base points of the charts of T robots and O objects, and of odometry biases."""

    spaces: Spaces
    robots: Array  # (T, s); the first precedes the first keyframe
    object_ids: Index  # (O,) ascending
    objects: Array  # (O, s)
    vectors: Mapping[int, Array]  # GTSAM key -> initial value of the bias

    @classmethod
    def of(cls, spaces: Spaces, values: gtsam.Values) -> "Charts":
        """Charts about ``values``."""
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
        """The charts with those of new variables, all estimates, and ``values`` at the new charts' base points.

        New variables are estimated at ``values``, the others are ``at`` their estimates. New base points are placed
        relative to each other, and to the newest base point before, as the estimates are: relative measurements between
        them then hold at the base points, however far the whole estimate has moved and turned. A rotation of the whole
        map thus changes no measurement.
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
        """Estimates of all robots and objects after (n,) steps, in which objects and then robots come last."""
        spaces, split = self.spaces, len(steps) - self.robots.shape[0] * self.spaces.layout.robot
        begin = split - self.objects.shape[0] * spaces.layout.landmark
        by_object = steps[begin:split].reshape(-1, spaces.layout.landmark)
        return self._after(steps[split:].reshape(-1, spaces.layout.robot), by_object)

    def begun(self) -> Located:
        """All robots and objects at the base points of their charts."""
        layout = self.spaces.layout
        return self._after(np.zeros((len(self.robots), layout.robot)), np.zeros((len(self.objects), layout.landmark)))

    def _after(self, by_robot: Array, by_object: Array) -> Located:
        return Located(
            robots=Stepped(self.spaces.robot, self.robots, by_robot),
            object_ids=self.object_ids,
            objects=Stepped(self.spaces.landmark, self.objects, by_object),
        )

    def values(self, at: Located, others: gtsam.Values) -> gtsam.Values:
        """The values ``others`` with robots and objects at their estimates ``at``."""
        found = gtsam.Values()
        for number, state in zip(self.object_ids.tolist(), at.objects.states, strict=True):
            self.spaces.landmark.insert(found, object_key(number), state)
        for row, state in enumerate(at.robots.states):
            self.spaces.robot.insert(found, robot_key(row - 1), state)
        return _changed(others, found)

    def points(self, keys: Sequence[int]) -> gtsam.Values:
        """Base points of the charts of some robots and objects."""
        values = gtsam.Values()
        for key in keys:
            number = number_of(key)
            point = self.robots[number] if is_robot(key) else self.objects[np.searchsorted(self.object_ids, number)]
            self.spaces.of(key).insert(values, key, point)
        return values


def _carried(space: StateSpace, states: Array, last: Array, point: Array) -> Array:
    """(n, s) points placed relative to ``point`` (s,) as states (n, s) are to ``last`` (s,); poses are x, y, yaw."""
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
    """A copy of ``values`` with robots and objects at other ``places``."""
    changed = gtsam.Values(values)
    changed.update(places)
    return changed
