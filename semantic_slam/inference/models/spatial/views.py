"""Viewpoints of cameras on objects in space.

Right perturbations of robot x and object o give for the camera in the object's frame v, its place in the body being s:
dv/dx = R_o^T R_x [-hat(s), I] and dv/do = [hat(v), -I].
"""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry import se3, so3
from semantic_slam.geometry.arrays import Array, squared_norms
from semantic_slam.inference.models.repeated_rows import repeated
from semantic_slam.inference.models.view_scores import Slopes
from semantic_slam.inference.states.kinds.spatial_objects import SpatialObjects
from semantic_slam.inference.states.kinds.spatial_poses import SpatialPoses
from semantic_slam.inference.states.spaces import LEAST_DISTANCE_M, Spaces, viewpoints_of
from semantic_slam.viewpoint.model import Viewpoints

POSES_IN_SPACE = Spaces(SpatialPoses(), SpatialObjects())
LEAST_COSINE = 1e-3
"""Least cosine of an elevation in Jacobians of azimuths, which are unbounded right above an object."""


@dataclass(frozen=True)
class SpatialViews:
    """Viewpoints between robots and objects in SE(3), with azimuth and elevation."""

    coordinates = slice(None)

    def seen(self, x: Array, o: Array, sensor: Array) -> tuple[Viewpoints, Slopes]:
        """Azimuths, elevations and ranges, with their Jacobians."""
        cameras = repeated(sensor, len(x))
        v = POSES_IN_SPACE.camera_positions(x, o, cameras)

        def slopes(by_viewpoint: Array) -> tuple[Array, Array]:
            by_view = by_viewpoint @ _spherical_slopes(v)
            turn = np.swapaxes(so3.matrix(o[:, 3:]), 1, 2) @ so3.matrix(x[:, 3:])
            by_camera = by_view @ turn
            return (
                _joined(so3.cross(cameras[:, None], by_camera), by_camera),
                _joined(so3.cross(by_view, v[:, None]), -by_view),
            )

        return viewpoints_of(v), slopes


def _spherical_slopes(v: Array) -> Array:
    """(B, 3, 3) derivatives of azimuth, elevation and range by the point ``v`` (B, 3)."""
    distance = np.maximum(np.sqrt(squared_norms(v)), LEAST_DISTANCE_M)
    aside = np.maximum(np.hypot(v[:, 0], v[:, 1]), LEAST_COSINE * distance)
    slopes = np.zeros((len(v), 3, 3))
    slopes[:, 0, 0], slopes[:, 0, 1] = -v[:, 1] / aside**2, v[:, 0] / aside**2
    slopes[:, 1, :2] = -v[:, :2] * (v[:, 2] / aside)[:, None]
    slopes[:, 1, 2] = aside
    slopes[:, 1] /= distance[:, None] ** 2
    slopes[:, 2] = v / distance[:, None]
    return slopes


def _joined(by_turn: Array, by_shift: Array) -> Array:
    """(B, m, 6) derivatives by tangent vectors of SE(3)."""
    found = np.empty((*by_shift.shape[:-1], 6))
    found[..., se3.ROTATION], found[..., se3.TRANSLATION] = by_turn, by_shift
    return found
