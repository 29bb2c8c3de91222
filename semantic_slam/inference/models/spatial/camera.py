"""Camera mount: its optical frame has z ahead, x to the right and y down in the image."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from semantic_slam.geometry import se3, so3
from semantic_slam.geometry.arrays import Array
from semantic_slam.perception.image_sight import ImageSight

LOOKS_AHEAD = np.array([0.0, 0.0, 0.0, -0.5, 0.5, -0.5, 0.5])
"""Optical frame of a camera at the body's origin that looks along the body's x axis."""


@dataclass(frozen=True)
class Camera:
    """A camera on the robot."""

    T_body_camera: Array = field(default_factory=lambda: LOOKS_AHEAD)  # (7,) of its optical frame
    sight: ImageSight | None = None  # edges and free ranges of its image; None: not known

    @cached_property
    def axes(self) -> Array:
        """(3, 3) rotation from the optical frame to the body frame."""
        return so3.matrix(self.T_body_camera[3:])

    def seen(self, points: Array) -> Array:
        """(..., 3) points of the body frame in the optical frame."""
        return so3.rotated(so3.inverse(self.T_body_camera[3:]), points - self.T_body_camera[:3])

    def in_body(self, points: Array) -> Array:
        """(..., 3) points of the optical frame in the body frame."""
        return np.asarray(self.T_body_camera[:3] + so3.rotated(self.T_body_camera[3:], points))

    def turned(self, covariances: Array) -> Array:
        """(..., 3, 3) covariances rotated from the axes of the body to those of the optical frame."""
        return np.asarray(self.axes.T @ covariances @ self.axes)

    def on(self, robots: Array) -> Array:
        """(..., 7) poses in map of the camera on robots (..., 7)."""
        return se3.compose(robots, self.T_body_camera)
