"""Motions between the frames of maps: SE(2) in the plane; in space a shift and a turn about the vertical.

A motion T (F,) is its shift, then its turn: x, y, yaw, or x, y, z, yaw, as gravity makes maps of space level. Errors of
a frame have the same order; their turn is about the vertical through a centre (2,).
"""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.object_coordinates import ObjectCoordinates, object_coordinates


@dataclass(frozen=True)
class MapFrames:
    """The motions of a state space, which act on the coordinates of its objects."""

    coordinates: ObjectCoordinates

    @classmethod
    def of(cls, state_space: str) -> "MapFrames":
        """The motions between maps of a state space, planar or spatial."""
        return cls(object_coordinates(state_space))

    @property
    def num_axes(self) -> int:
        """Number of coordinates of a position, which are an object's first ones."""
        return 2 if self.coordinates.has_yaw else 3

    @property
    def size(self) -> int:
        """F."""
        return self.num_axes + 1

    def sigmas(self, sigma_m: float, sigma_rad: float) -> Array:
        """(F,) standard deviations of a motion."""
        return np.append(np.full(self.num_axes, sigma_m), sigma_rad)

    def coordinate_sigmas(self, sigma_m: float, sigma_rad: float) -> Array:
        """(3,) standard deviations of an object's coordinates."""
        return np.array([sigma_m, sigma_m, sigma_rad if self.coordinates.has_yaw else sigma_m])

    def compose(self, T: Array, other: Array) -> Array:
        """``other`` (F,), then ``T`` (F,)."""
        return self._with_height(se2.compose(_flat(T), _flat(other)), T[2] + other[2])

    def inverse(self, T: Array) -> Array:
        """The motion (F,) back."""
        return self._with_height(se2.inverse(_flat(T)), -T[2])

    def moved(self, T: Array, states: Array) -> Array:
        """Coordinates (n, 3) in the frame that has theirs at ``T`` (F,)."""
        if self.coordinates.has_yaw:
            return se2.compose(np.broadcast_to(T, states.shape), states)
        level = np.column_stack([states[:, :2], np.zeros(len(states))])
        turned = se2.compose(np.broadcast_to(_flat(T), level.shape), level)
        return np.column_stack([turned[:, :2], states[:, 2] + T[2]])

    def turn(self, T: Array) -> Array:
        """(3, 3) by which a motion turns covariances of coordinates."""
        cos, sin = np.cos(T[-1]), np.sin(T[-1])
        return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])

    def slopes(self, states: Array, centre: Array) -> Array:
        """(n, 3, F) Jacobians of n objects' coordinates by errors of their frame about ``centre``."""
        slopes = np.zeros((len(states), 3, self.size))
        slopes[:, :, :3] = np.eye(3)
        slopes[:, 0, -1], slopes[:, 1, -1] = -(states[:, 1] - centre[1]), states[:, 0] - centre[0]
        return slopes

    def about(self, centre: Array, error: Array) -> Array:
        """The motion (F,) of an error (F,) about ``centre``."""
        shift = centre + error[:2] - self.turn(error)[:2, :2] @ centre
        return self._with_height(np.append(shift, error[-1]), error[2])

    def error_about(self, centre: Array, T: Array) -> Array:
        """The error (F,) about ``centre`` that is the motion ``T`` (F,)."""
        at = self.turn(T)[:2, :2] @ centre + T[:2]
        return self._with_height(np.append(at - centre, T[-1]), T[2])

    def _with_height(self, planar: Array, height: float) -> Array:
        """(F,) from x, y, yaw; the height counts in space alone."""
        return planar if self.coordinates.has_yaw else np.array([*planar[:2], height, planar[2]])


def _flat(T: Array) -> Array:
    """(3,) x, y, yaw of a motion."""
    return np.append(T[:2], T[-1])
