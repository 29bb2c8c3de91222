"""Marginalisation of old keyframes: their poses are integrated out into one Gaussian factor over what they observed.

The poses before some keyframe, and what only they are tied to, are eliminated from the factors that hold them,
linearised at the estimate; by a QR factorisation, which loses nothing where all is linear. What is left is one dense
factor over the pose of that keyframe, the objects that earlier poses have seen, and the newest odometry bias. Its size
is the number of objects, however long the drive is: the cost of an update does not grow with time.

The Gaussian is over the objects in the frame of that pose, and over the pose itself: a rotation of the whole map, as
every loop closure causes to some degree, then brings no linearisation error. What is lost is second order in later
relative motion of the map.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import gtsam
import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.inference.models.callback_factor import callback_factor
from semantic_slam.inference.smoothing.past import summary_in_plane, summary_in_space
from semantic_slam.inference.states.spaces import Spaces

NOWHERE: Mapping[int, Array] = MappingProxyType({})
"""No ray origins."""


@dataclass(frozen=True, kw_only=True)
class Summary:
    """A joint Gaussian factor over n variables of m dimensions, |R (y - y') - e|^2 / 2, y being their coordinates."""

    keys: tuple[int, ...]  # n, ascending; a single robot pose among them
    root: Array  # (m, m) R
    right: Array  # (m,) e
    coordinates: Array  # (m,) y'; in space (q,) states relative to the robot, from which y are deviations
    anchors: dict[int, Array] = field(default_factory=dict)  # object key -> (3,) origin of its first ray, seen likewise

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
        if spaces.name == "spatial":
            return summary_in_space.deviations(spaces, self.keys, values, self.coordinates, self.anchors)
        now, slopes, turns = summary_in_plane.coordinates(spaces, self.keys, values)
        apart = now - self.coordinates
        apart[turns] = wrap_angle(apart[turns])
        return apart, slopes

    def _blocks(self, columns: Array, values: gtsam.Values) -> list[Array]:
        """The columns of each variable."""
        sizes = values.extract(list(self.keys)).dims()
        ends = np.cumsum([sizes[key] for key in self.keys])[:-1]
        return [np.asfortranarray(block) for block in np.split(columns, ends, axis=1)]


def summary_of(
    spaces: Spaces,
    factors: Sequence[Any],
    values: gtsam.Values,
    gone: Collection[int],
    anchors: Mapping[int, Array] = NOWHERE,
) -> Summary:
    """The marginal of nonlinear ``factors``, linearised at ``values``, without the variables that are ``gone``.

    Every factor must involve a variable that goes. ``anchors`` (3,) in map, by the keys of points in space that were
    first seen by rays alone.
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
    anchors = {key: anchors[key] for key in kept if key in anchors}
    coordinates, slopes, seen = _here(spaces, kept, values, anchors)
    rows, size = _triangle(graph.augmentedJacobian(ordering)), len(slopes)
    first = rows.shape[1] - 1 - size
    left, rest = rows[first : first + size, first:], np.zeros((size, size + 1))
    rest[: len(left)] = left
    root = np.linalg.solve(slopes.T, rest[:, :-1].T).T
    return Summary(
        keys=kept,
        root=np.asarray(root, dtype=float),
        right=rest[:, -1].copy(),
        coordinates=coordinates,
        anchors=seen,
    )


def _here(
    spaces: Spaces, keys: Sequence[int], values: gtsam.Values, anchors: Mapping[int, Array]
) -> tuple[Array, Array, dict[int, Array]]:
    """Coordinates of variables at ``values``, their Jacobian by tangent vectors, and anchors in the robot's frame."""
    if spaces.name != "spatial":
        coordinates, slopes, _ = summary_in_plane.coordinates(spaces, keys, values)
        return coordinates, slopes, {}
    seen = summary_in_space.seen_anchors(spaces, spaces.robot.state(values, keys[-1]), anchors)
    coordinates = summary_in_space.relative_states(spaces, keys, values)
    return coordinates, summary_in_space.deviations(spaces, keys, values, coordinates, seen)[1], seen


def _triangle(rows: Array) -> Array:
    """The upper triangle R of rows = Q R."""
    return np.asarray(np.linalg.qr(rows, mode="r"), dtype=float)
