"""Viewpoints of cameras on objects in the plane."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.planar.frames import camera_in_object
from semantic_slam.inference.models.planar.polar import polar, polar_jacobian
from semantic_slam.inference.models.planar.slopes import by_camera, by_pose
from semantic_slam.inference.models.repeated_rows import repeated
from semantic_slam.inference.models.view_scores import Slopes
from semantic_slam.viewpoint.model import Viewpoints


@dataclass(frozen=True)
class PlanarViews:
    """Viewpoints between robots and objects with states x, y, yaw: elevation is 0."""

    coordinates = slice(None, None, 2)

    def seen(self, x: Array, o: Array, sensor: Array) -> tuple[Viewpoints, Slopes]:
        """Azimuths and ranges, with their Jacobians."""
        v = camera_in_object(x, o, repeated(sensor, len(x)))
        distance, azimuth = polar(v)

        def slopes(by_viewpoint: Array) -> tuple[Array, Array]:
            radial, turn = polar_jacobian(v, distance)
            by_view = by_viewpoint[..., :1] * turn[:, None]
            by_view += by_viewpoint[..., 1:] * radial[:, None]
            return by_camera(by_view, x[:, 2] - o[:, 2], sensor), by_pose(by_view, v)

        return Viewpoints(azimuth, np.zeros_like(azimuth), distance), slopes
