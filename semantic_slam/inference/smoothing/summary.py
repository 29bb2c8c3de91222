"""Keyframes of long ago summarised: their poses marginalised out, into one Gaussian over what they have seen.

The poses before some keyframe, and what only they are tied to, are integrated out of the factors that hold them, made
linear at the estimate; by a QR factorisation, so that a summary is as good as the graph where all is linear. What is
left is one dense factor over the pose of that keyframe, the objects that those before it have seen, and the newest bias
of odometry. It has as many objects as there are, however long the drive: updates cost the same on any day.

What is lost is of the second order: poses that are gone are not made linear anew when the map moves, and until the next
summary GTSAM keeps the factor's slopes in the frames where they were made.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

import gtsam
import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.linear_factors import unit_noise
from semantic_slam.inference.states.keys import is_vector
from semantic_slam.inference.states.spaces import Spaces


@dataclass(frozen=True, kw_only=True)
class Summary:
    """A Gaussian over n variables of m dimensions together: |R d - e|^2 / 2 of the steps d from their ``points``."""

    keys: tuple[int, ...]  # n, ascending
    root: Array  # (m, m) R, upper triangular
    right: Array  # (m,) e
    points: gtsam.Values  # n

    def factor(self) -> Any:
        """For GTSAM's nonlinear graphs."""
        return gtsam.LinearContainerFactor(self._dense(self.root, self.right), self.points)

    def is_in(self, factor: Any) -> bool:
        """Whether a factor is that of this summary: no other linear one is over the same variables."""
        return isinstance(factor, gtsam.LinearContainerFactor) and tuple(factor.keys()) == self.keys

    def linearised(self, spaces: Spaces, values: gtsam.Values) -> Any:
        """For GTSAM's linear graphs, in steps from the ``values``, along the axes of the variables there."""
        now, sizes = values.extract(list(self.keys)), self.points.dims()
        apart = self.points.localCoordinates(now)
        steps, slopes, end = np.zeros(len(self.right)), np.eye(len(self.right)), 0
        for key in self.keys:
            begin, end = end, end + sizes[key]
            steps[begin:end] = apart.at(key)
            slopes[begin:end, begin:end] = _slopes(spaces, key, self.points, now)
        return self._dense(self.root @ slopes, self.right - self.root @ steps)

    def _dense(self, root: Array, right: Array) -> Any:
        """A linear factor, which GTSAM makes of many variables as a density of all of them alone."""
        sizes = self.points.dims()
        blocks = np.split(root, np.cumsum([sizes[key] for key in self.keys])[:-1], axis=1)
        terms = list(zip(self.keys, blocks, strict=True))
        return gtsam.JacobianFactor(gtsam.GaussianConditional(terms, len(terms), right, unit_noise(len(right))))


def summary_of(
    spaces: Spaces, factors: Sequence[Any], before: Summary | None, values: gtsam.Values, gone: Collection[int]
) -> Summary:
    """What nonlinear ``factors``, linear at the ``values``, and a summary ``before`` say without variables ``gone``.

    Every one of them is over a variable that goes.
    """
    touched = gtsam.NonlinearFactorGraph()
    for factor in factors:
        touched.add(factor)
    graph = touched.linearize(values)
    if before is not None:
        graph.add(before.linearised(spaces, values))
    every = sorted(set(graph.keyVector()))
    kept = [key for key in every if key not in gone]
    ordering = gtsam.Ordering()
    for key in (*(key for key in every if key in gone), *kept):
        ordering.push_back(key)
    points = values.extract(kept)
    size = sum(points.dims().values())
    rows = np.linalg.qr(graph.augmentedJacobian(ordering), mode="r")
    first = rows.shape[1] - 1 - size
    left, rest = rows[first : first + size, first:], np.zeros((size, size + 1))
    rest[: len(left)] = left
    return Summary(keys=tuple(kept), root=rest[:, :-1].copy(), right=rest[:, -1].copy(), points=points)


def _slopes(spaces: Spaces, key: int, points: gtsam.Values, now: gtsam.Values) -> Array:
    """(d, d) change of a variable's step from its point by a step from where it is now."""
    space = None if is_vector(key) else spaces.of(key)
    if space is None or space.heading is None:
        return np.eye(points.dims()[key])
    turn = space.state(now, key)[2] - space.state(points, key)[2]
    cos, sin = np.cos(turn), np.sin(turn)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
