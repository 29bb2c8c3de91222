"""Marginalisation of old keyframes: their poses are integrated out into one Gaussian factor over what they observed.

The poses before some keyframe, and what only they are tied to, are eliminated from the factors that hold them,
linearised at the estimate; by a QR factorisation, which loses nothing where all is linear. What is left is one dense
factor over the pose of that keyframe, the objects that earlier poses have seen, and the newest odometry bias. Its size
is the number of objects, however long the drive is: the cost of an update does not grow with time.

The Gaussian is over the objects in the frame of that pose, and over the pose itself: a rotation of the whole map, as
every loop closure causes to some degree, then brings no linearisation error. What is lost is second order in later
relative motion of the map.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

import gtsam
import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.inference.models.callback_factor import callback_factor
from semantic_slam.inference.states.keys import is_robot, is_vector
from semantic_slam.inference.states.spaces import Spaces


@dataclass(frozen=True, kw_only=True)
class Summary:
    """A joint Gaussian factor over n variables of m dimensions, |R (y - y') - e|^2 / 2, y being their coordinates."""

    keys: tuple[int, ...]  # n, ascending; a single robot pose among them
    root: Array  # (m, m) R
    right: Array  # (m,) e
    coordinates: Array  # (m,) y'

    def factor(self, spaces: Spaces) -> Any:
        """GTSAM factor; a callback, as GTSAM keeps the Jacobian of a linear factor in tangent frames that rotate."""

        def error(this: Any, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
            apart, slopes = self._apart(spaces, values)
            if jacobians is not None:
                for number, block in enumerate(self._blocks(self.root @ slopes, values)):
                    jacobians[number] = block
            return np.asarray(self.root @ apart - self.right)

        return callback_factor(self, self.keys, len(self.right), error)

    def _apart(self, spaces: Spaces, values: gtsam.Values) -> tuple[Array, Array]:
        """(m,) difference of the coordinates at some values from y', and their (m, m) Jacobian."""
        now, slopes, turns = _coordinates(spaces, self.keys, values)
        apart = now - self.coordinates
        apart[turns] = wrap_angle(apart[turns])
        return apart, slopes

    def _blocks(self, columns: Array, values: gtsam.Values) -> list[Array]:
        """The columns of each variable."""
        sizes = values.extract(list(self.keys)).dims()
        ends = np.cumsum([sizes[key] for key in self.keys])[:-1]
        return [np.asfortranarray(block) for block in np.split(columns, ends, axis=1)]


def summary_of(spaces: Spaces, factors: Sequence[Any], values: gtsam.Values, gone: Collection[int]) -> Summary:
    """The marginal of nonlinear ``factors``, linearised at ``values``, without the variables that are ``gone``.

    Every factor must involve a variable that goes.
    """
    touched = gtsam.NonlinearFactorGraph()
    for factor in factors:
        touched.add(factor)
    graph = touched.linearize(values)
    every = sorted(set(graph.keyVector()))
    kept = tuple(key for key in every if key not in gone)
    ordering = gtsam.Ordering()
    for key in (*(key for key in every if key in gone), *kept):
        ordering.push_back(key)
    coordinates, slopes, _ = _coordinates(spaces, kept, values)
    rows, size = _triangle(graph.augmentedJacobian(ordering)), len(coordinates)
    first = rows.shape[1] - 1 - size
    left, rest = rows[first : first + size, first:], np.zeros((size, size + 1))
    rest[: len(left)] = left
    root = np.linalg.solve(slopes.T, rest[:, :-1].T).T
    return Summary(keys=kept, root=np.asarray(root, dtype=float), right=rest[:, -1].copy(), coordinates=coordinates)


def _triangle(rows: Array) -> Array:
    """The upper triangle R of rows = Q R."""
    return np.asarray(np.linalg.qr(rows, mode="r"), dtype=float)


def _coordinates(spaces: Spaces, keys: Sequence[int], values: gtsam.Values) -> tuple[Array, Array, list[int]]:
    """(m,) coordinates of variables, their (m, m) Jacobian by tangent vectors at ``values``, and which are angles.

    A planar robot pose keeps its own coordinates; objects are expressed in its frame.
    """
    sizes = values.extract(list(keys)).dims()
    ends = np.cumsum([sizes[key] for key in keys]).tolist()
    parts = {key: slice(end - sizes[key], end) for key, end in zip(keys, ends, strict=True)}
    found, slopes = np.zeros(ends[-1]), np.eye(ends[-1])
    for key, part in parts.items():
        state = values.atVector(key) if is_vector(key) else spaces.of(key).state(values, key)
        found[part] = state
        if _turns(spaces, key):
            slopes[part, part][:2, :2] = _rotation(state[2])
    robot = next((key for key in keys if is_robot(key) and _turns(spaces, key)), None)
    if robot is not None:
        for key, part in parts.items():
            if not is_vector(key) and key != robot:
                _see(found, slopes, parts[robot], part)
    turns = [part.start + 2 for key, part in parts.items() if _turns(spaces, key)]
    return found, slopes, turns


def _turns(spaces: Spaces, key: int) -> bool:
    """Whether a variable is a pose (has a heading)."""
    return not is_vector(key) and spaces.of(key).heading is not None


def _see(found: Array, slopes: Array, robot: slice, part: slice) -> None:
    """Transform an object's map coordinates, and their Jacobian, into the robot's frame, in place."""
    back = _rotation(found[robot][2]).T
    found[part.start : part.start + 2] = seen = back @ (found[part][:2] - found[robot][:2])
    slopes[part, part][:2] = back @ slopes[part, part][:2]
    slopes[part, robot][:2] = [[-1.0, 0.0, seen[1]], [0.0, -1.0, -seen[0]]]
    if part.stop - part.start > 2:
        found[part.start + 2] -= found[robot][2]
        slopes[part, robot][2, 2] = -1.0


def _rotation(angle_rad: float) -> Array:
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[cos, -sin], [sin, cos]])
