"""Odometry and detections as batches: residuals and Jacobians of many at once, without a callback for each."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.rows import joined_rows
from semantic_slam.inference.models.observation import ObservationModel
from semantic_slam.inference.smoothing.linear.located import Located, Stepped
from semantic_slam.inference.states.keys import bias_key, object_key, robot_key
from semantic_slam.inference.states.spaces import Spaces


@dataclass(frozen=True)
class Slopes:
    """B whitened residuals of m components at the states of two variables each, and their Jacobians there."""

    first: Stepped  # B
    second: Stepped  # B
    residual: Array  # (B, m)
    by_first: Array  # (B, m, d) by the first variable's tangent space
    by_second: Array  # (B, m, d)


@dataclass(frozen=True, kw_only=True)
class Motions:
    """B odometry motions of r dimensions each, linear in p biases."""

    rows: Index  # (B,) of the robots that they lead to
    controls: Array  # (B, s)
    roots: Array  # (B, r, r) whitening matrices
    by_bias: Array  # (B, r, p) Jacobian of the whitened residuals
    offset: Array  # (B, r) of the residuals by the biases at their chart origins

    @classmethod
    def one(cls, keyframe: int, control: Array, covariance: Array, by_bias: Array | None) -> "Motions":
        """The motion to one keyframe; ``by_bias`` (r, p) is the Jacobian of the control."""
        root = np.linalg.inv(np.linalg.cholesky(covariance))
        slopes = np.zeros((len(root), 0)) if by_bias is None else -root @ by_bias
        return cls(
            rows=np.array([keyframe + 1]),
            controls=control[None],
            roots=root[None],
            by_bias=slopes[None],
            offset=np.zeros((1, len(root))),
        )

    def with_offsets(self, point: Callable[[int], Array]) -> "Motions":
        """The motions with chart origins of biases at each key's ``point``."""
        if not self.by_bias.shape[2]:
            return self
        biases = np.array([point(bias_key(row - 1)) for row in self.rows.tolist()])
        return replace(self, offset=(self.by_bias @ biases[..., None])[..., 0])

    def sides(self, at: Located) -> tuple[Stepped, Stepped]:
        """B robots that the motions lead from, and B that they lead to."""
        return at.robots_of(self.rows - 1), at.robots_of(self.rows)

    def measured(self, spaces: Spaces, model: ObservationModel, first: Stepped, second: Stepped) -> Slopes:
        """Residuals and Jacobians of the controls between robots of :meth:`sides`, without biases."""
        space = spaces.robot
        moved = space.between(first.states, second.states)
        error = space.local(self.controls, moved)
        by_second = self.roots @ np.linalg.inv(space.exp_and_jacobian(error)[1])
        residual = (self.roots @ error[..., None])[..., 0]
        return Slopes(first, second, residual, -by_second @ space.propagation(moved), by_second)

    def terms(self) -> list[tuple[int, int, list[Any]]]:
        """Keys of the two variables of each motion, and key and Jacobian (r, p) of the biases."""
        numbers = (self.rows - 1).tolist()
        biases = self.by_bias if self.by_bias.shape[2] else ()
        repeated: list[list[Any]] = [[bias_key(n), own] for n, own in zip(numbers, biases, strict=False)]
        keys = [(robot_key(n - 1), robot_key(n)) for n in numbers]
        return [(*pair, own) for pair, own in zip(keys, repeated or [[] for _ in keys], strict=True)]


@dataclass(frozen=True, kw_only=True)
class Sightings:
    """B detections of objects, whitened by their white noise, and linear in their correlated errors."""

    scale: Array  # (B,) of residuals whitened by the whole error
    seen: Any  # (B,) the observation model's arrays
    rows: Index  # (B,) of the robots
    ids: Index  # (B,) of the objects
    by_error: Array  # (B, 2) Jacobian of range and bearing by own correlated errors
    keys: Index  # (B,) of the variables that hold these errors
    firsts: Index  # (B,) index of the errors within them
    sizes: Index  # (B,) of these variables
    offset: Array  # (B, 2) of the residuals by the errors at their chart origins

    def with_offsets(self, point: Callable[[int], Array]) -> "Sightings":
        """The sightings with chart origins of correlated errors at each key's ``point``."""
        own, rows = np.unique(self.keys, return_inverse=True)
        points = [point(key) for key in own.tolist()]
        begins = np.cumsum([0, *(len(part) for part in points)])[rows] + self.firsts
        errors = np.concatenate(points)[begins[:, None] + np.arange(2)]
        return replace(self, offset=self.by_error * errors)

    def sides(self, at: Located) -> tuple[Stepped, Stepped]:
        """B robots that see, and B objects that are seen."""
        return at.robots_of(self.rows), at.objects_of(self.ids)

    def measured(self, spaces: Spaces, model: ObservationModel, first: Stepped, second: Stepped) -> Slopes:
        """Residuals and Jacobians of range and bearing at :meth:`sides`, without the correlated errors."""
        part = model.geometry(self.seen, first.states, second.states)
        scale, by = self.scale[:, None], (part.jacobian_robot, part.jacobian_object)
        return Slopes(first, second, scale * part.residual, *(scale[..., None] * slopes for slopes in by))

    def terms(self) -> list[tuple[int, int, list[Any]]]:
        """Keys of the two variables of each sighting, and key and Jacobian (2, q) of the correlated errors."""
        slopes, at = np.zeros((len(self.rows), 2, self.sizes.max(initial=0))), np.arange(len(self.rows))
        slopes[at, 0, self.firsts], slopes[at, 1, self.firsts + 1] = self.by_error.T
        robots, objects = [robot_key(n) for n in (self.rows - 1).tolist()], [object_key(n) for n in self.ids.tolist()]
        repeated = [
            [key, own[:, :size]] for key, own, size in zip(self.keys.tolist(), slopes, self.sizes.tolist(), strict=True)
        ]
        return list(zip(robots, objects, repeated, strict=True))


Measured = Motions | Sightings


def joined(parts: Sequence[Measured]) -> Measured:
    """The measurements of several parts, all of one kind."""
    if isinstance(parts[0], Motions):
        return joined_rows(parts, ())
    seen = joined_rows([part.seen for part in parts if isinstance(part, Sightings)], ())
    return replace(joined_rows(parts, ("seen",)), seen=seen)
