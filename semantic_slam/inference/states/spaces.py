"""The state spaces of robot and landmarks, which may differ, and the relations between their states.

Arrays of both kinds of states have one row per state, the robot's first, each as wide as the wider kind.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import gtsam
import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.states.keys import is_object, is_robot
from semantic_slam.inference.states.kinds.mixed_states import MixedStates
from semantic_slam.inference.states.kinds.planar_objects import PlanarObjects, PosesAmongObjects
from semantic_slam.inference.states.kinds.spatial_objects import SpatialObjects, SpatialPosesAmongObjects
from semantic_slam.inference.states.kinds.state_space import StateArithmetic, StateSpace
from semantic_slam.inference.states.layout import Layout
from semantic_slam.viewpoint.model import Viewpoints

LEAST_DISTANCE_M = 1e-6
"""Least distance of camera and landmark, so that a viewing direction is defined where they coincide."""
PLANE = 2
"""Number of coordinates of a position in the plane."""


@dataclass(frozen=True)
class RelativePosition:
    """Positions of landmarks in the frames of robots (p components), with Jacobians (tangent spaces of r and l)."""

    point: Array  # (..., p) metres
    by_robot: Array  # (..., p, r) Jacobian by the robot's state
    by_landmark: Array  # (..., p, l) Jacobian by the landmark's state


@dataclass(frozen=True, eq=False)
class Spaces:
    """The state spaces of the robot and of the landmarks."""

    robot: StateSpace
    landmark: StateSpace

    @classmethod
    def same(cls, space: StateSpace) -> "Spaces":
        """A single space for robot and landmarks."""
        return cls(space, space)

    @cached_property
    def are_same(self) -> bool:
        """Whether robot and landmarks have the same space, chart included."""
        return self.robot == self.landmark

    @cached_property
    def are_alike(self) -> bool:
        """Whether robot and landmarks are stored alike, and of one type for GTSAM; their charts may differ."""
        return isinstance(self.landmark, type(self.robot))

    @property
    def name(self) -> str:
        """Name of the robot's space as beliefs state it, "planar" or "spatial"."""
        return "planar" if self.robot.position(self.robot.origin).shape[-1] == PLANE else "spatial"

    @cached_property
    def layout(self) -> Layout:
        """Layout of tangent vectors of a robot and its landmarks."""
        return Layout(self.robot.tangent_size, self.landmark.tangent_size)

    @cached_property
    def storage(self) -> Layout:
        """Layout of states of a robot and its landmarks."""
        return Layout(self.robot.storage_size, self.landmark.storage_size)

    @cached_property
    def joint(self) -> StateArithmetic:
        """Calculus over (..., 1 + n, s) states."""
        return self._rows(None)

    def joint_with_motions(self, num_landmarks: int) -> StateArithmetic:
        """Calculus over (..., 1 + n + T, s): a robot, n landmarks and T motions of the robot."""
        return self._rows(1 + num_landmarks)

    def _rows(self, end: int | None) -> StateArithmetic:
        """Calculus over rows of which those from 1 up to ``end`` are landmarks; None: up to the last one."""
        if self.are_same:
            return self.robot
        if isinstance(self.landmark, PlanarObjects) and self.are_alike:
            return PosesAmongObjects(end)
        if isinstance(self.landmark, SpatialObjects) and self.are_alike:
            return SpatialPosesAmongObjects(end)
        return MixedStates(self.robot, self.landmark, end)

    def of(self, key: int) -> StateSpace:
        """The space of a GTSAM variable."""
        return self.robot if self.are_same or is_robot(key) else self.landmark

    def own(self, key: int, state: Array) -> Array:
        """(..., s) the columns of a row (..., w) that the variable ``key`` uses."""
        return state if self.are_alike else state[..., : self.of(key).storage_size]

    def kinds(self, count: int) -> list[tuple[StateSpace, slice]]:
        """The distinct spaces of ``count`` rows, the robot's first, each with a slice of its rows."""
        if self.are_same:
            return [(self.robot, slice(0, count))]
        return [(self.robot, slice(0, 1)), (self.landmark, slice(1, count))]

    def states(self, values: gtsam.Values) -> Array:
        """(n, w) of all robots and landmarks, by ascending key: landmarks come first."""
        if self.are_alike:
            return self.robot.states(values)
        keys = values.keys()
        robots, landmarks = (sum(map(kind, keys)) for kind in (is_robot, is_object))
        landmark_states = self.landmark.states(values) if landmarks else np.zeros((0, self.storage.landmark))
        # Other variables of the same GTSAM type have smaller keys, and come before all of these.
        return self.storage.stacked(
            landmark_states[len(landmark_states) - landmarks :], self.robot.states(values)[-robots:]
        )

    def are_within(self, changes: Array, count: int) -> bool:
        """Whether changes of ``count`` variables, landmarks first, are within relinearisation thresholds; NaN: no."""
        if self.are_alike:
            return bool((changes.reshape(-1, self.layout.width) <= self.robot.relinearize_threshold).all())
        robots = (len(changes) - count * self.layout.landmark) // (self.layout.robot - self.layout.landmark)
        split = (count - robots) * self.layout.landmark
        parts = ((self.landmark, changes[:split]), (self.robot, changes[split:]))
        return all(bool((part.reshape(-1, s.tangent_size) <= s.relinearize_threshold).all()) for s, part in parts)

    def largest_change(self, keys: Sequence[int], before: Array, after: Sequence[Array]) -> float:
        """Largest change of a tangent coordinate, metres or radians, from n states ``before`` (n, w) to ``after``."""
        if self.are_alike:
            return float(np.abs(self.robot.local(before, np.array(after))).max())
        pairs = zip(keys, before, after, strict=True)
        changes = (self.of(key).local(self.own(key, state), other) for key, state, other in pairs)
        return max(float(np.abs(change).max()) for change in changes)

    def steps(self, pairs: Array) -> tuple[Array, Array]:
        """(n, r) and (n, l) tangent vectors from the spaces' origins to robots and landmarks (n, s + s)."""
        r = self.storage.robot
        if self.are_alike:  # in GTSAM's chart
            steps = self.robot.local(self.robot.origin, pairs.reshape(-1, r)).reshape(len(pairs), -1)
            return steps[:, : self.layout.robot], steps[:, self.layout.robot :]
        robots = self.robot.local(self.robot.origin, pairs[:, :r])
        return robots, self.landmark.local(self.landmark.origin, pairs[:, r:])

    def seen(self, x: Array, o: Array) -> Array:
        """(n, s) landmarks relative to robots: as poses if both are stored alike, else as positions."""
        return self.robot.between(x, o) if self.are_alike else self.relative_position(x, o).point

    def relative_position(self, x: Array, o: Array) -> RelativePosition:
        """Positions of landmarks ``o`` (..., s) in the frames of robots ``x`` (..., s), with Jacobians."""
        point, by_robot, by_point = self.robot.in_frame(x, self.landmark.position(o))
        return RelativePosition(point, by_robot, by_point @ self.landmark.position_slopes(o))

    def viewpoints(self, x: Array, o: Array, sensor: Array) -> Viewpoints:
        """Viewpoints from where the cameras of robots ``x`` (B, s) see landmarks ``o`` (B, s).

        ``sensor`` (q,) or (B, q) in the body frame; in the plane its third component, if given, yields an elevation.
        """
        return viewpoints_of(self.camera_positions(x, o, sensor))

    def camera_positions(self, x: Array, o: Array, sensor: Array) -> Array:
        """(B, q) positions of the cameras of robots ``x`` (B, s) in the frames of landmarks ``o`` (B, s)."""
        return self.landmark.turned_back(o, self.robot.displacement(x, sensor, self.landmark.position(o)))

    def in_map(self, states: Array, covariances: Array) -> tuple[Array, Array]:
        """(..., n, 7) pose vectors and (..., n, 6, 6) covariances of (..., n, w) states, the robot's first.

        The robot's covariance is that of its errors about its pose, which are along arcs.
        """
        poses, spreads = [], []
        for space, rows in ((self.robot, slice(0, 1)), (self.landmark, slice(1, None))):
            part, size = states[..., rows, : space.storage_size], space.tangent_size
            stated = space.covariances if rows.start else space.moments
            poses.append(space.poses(part))
            spreads.append(stated(part, covariances[..., rows, :size, :size]))
        return np.concatenate(poses, axis=-2), np.concatenate(spreads, axis=-3)


def viewpoints_of(v: Array) -> Viewpoints:
    """Viewpoints of cameras at positions ``v`` (B, 2 or 3), given in the frames of the objects that they see."""
    squared = v[:, 0] * v[:, 0] + v[:, 1] * v[:, 1]
    azimuth, elevation = np.arctan2(v[:, 1], v[:, 0]), np.zeros(len(v))
    if v.shape[1] > PLANE:
        elevation = np.arctan2(v[:, 2], np.sqrt(squared))
        squared = squared + v[:, 2] * v[:, 2]
    return Viewpoints(azimuth, elevation, np.maximum(np.sqrt(squared), LEAST_DISTANCE_M))
