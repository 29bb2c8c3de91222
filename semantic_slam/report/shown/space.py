"""What a run in space has beside its floor plan, as plain data that the page's script draws."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.spatial.camera import Camera

IMAGE_ANGLES_RAD = {"field_of_view_rad": 1.0, "vertical_field_of_view_rad": 0.75}
"""Angles of a picture from left to right and from top to bottom, where a run does not say."""
WIDEST_RAD = 2.4
"""A wider picture is drawn as one of such an angle: a pyramid has no room for more."""


def principal_axes(covariances: Array) -> Array:
    """(N, 9) the three principal axes of positions, each one standard deviation [m] long, shortest first.

    ``covariances`` is (N, 3, 3) or more, such as (N, 6, 6), in map; what is not known of them is NaN.
    """
    places = covariances[:, :3, :3]
    known = np.asarray(np.isfinite(places).all(axis=(1, 2)))
    variances, axes = np.linalg.eigh(np.where(known[:, None, None], places, 0.0))
    scaled = axes * np.sqrt(np.maximum(variances, 0.0))[:, None, :]
    return np.where(known[:, None], scaled.swapaxes(1, 2).reshape(-1, 9), np.nan)


def camera_pyramid(camera: Camera, open_world: Mapping[str, Any]) -> Array:
    """(5, 3) the camera and, a metre ahead of it, the corners of what it sees, in the body frame.

    The edges of its image where they are known, else those of the settings ``open_world``, about the optical axis.
    """
    if camera.sight is not None:
        edges = np.clip(camera.sight.edges_rad, -WIDEST_RAD / 2.0, WIDEST_RAD / 2.0)
    else:
        angles = [min(open_world.get(name) or default, WIDEST_RAD) for name, default in IMAGE_ANGLES_RAD.items()]
        edges = np.array(angles)[:, None] * [-0.5, 0.5]
    (left, right), (top, bottom) = np.tan(edges)
    corners = [[left, top, 1.0], [right, top, 1.0], [right, bottom, 1.0], [left, bottom, 1.0]]
    return camera.in_body(np.array([[0.0, 0.0, 0.0], *corners]))
