"""Positions of objects from boxes and depth, in the camera's level body frame, with their covariances.

A box shows an object's outline: the middle of what it stands on lies in the middle half of the box, and behind the
surface that is seen by between nothing (flat things) and half the width that is seen (round and square ones), all
alike: a uniform distribution of width w has the standard deviation w / sqrt(12). A box that the picture's edge cuts may
go on for as much as it shows.
"""

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array
from semantic_slam.perception.frame import CameraModel
from semantic_slam.perception.range_bearing import depth_in_box, viewing_ray

LEAST_SIGMA_M = 0.02
"""What depth, its registration to colour and a hand that shakes leave unknown of any place."""
SIGMA_PER_SQUARE_METRE = 0.003
"""Standard deviation of structured light at one metre; it grows with the square of the distance (Khoshelham and
Elberink, Sensors 2012)."""
UNIFORM = 1.0 / np.sqrt(12.0)
EDGE_PX = 3.0
"""A box so near to the picture's edge is cut by it."""
FARTHEST_M = 10.0


def place_of_box(
    box: Array, depth_m: NDArray[np.float32], camera: CameraModel, R_body_camera: Array, depth_to_width: float
) -> tuple[Array, Array]:
    """(3,) position in the body frame and (3, 3) covariance of the object in a (4,) box; NaN without depth.

    The position lies ``depth_to_width`` of the width that is seen behind the surface, on the ray through the middle.
    """
    depth = depth_in_box(depth_m, box, FARTHEST_M)
    ray = viewing_ray(box, camera)
    width, height = np.array([box[2] - box[0], box[3] - box[1]]) * depth / np.array([camera.fx, camera.fy])
    distance = depth / ray[2] + depth_to_width * width
    sideways, upwards = is_cut(box, camera)
    floor = np.hypot(LEAST_SIGMA_M, SIGMA_PER_SQUARE_METRE * distance**2)
    sigmas = np.array(
        [
            np.hypot((1.0 if sideways else 0.5) * UNIFORM * width, floor),
            np.hypot((1.0 if upwards else 0.5) * UNIFORM * height, floor),
            np.hypot(UNIFORM * width, floor),
        ]
    )
    across = np.cross(np.array([0.0, 1.0, 0.0]), ray)
    across /= np.linalg.norm(across)
    axes = R_body_camera @ np.stack([across, np.cross(ray, across), ray], axis=1)
    return R_body_camera @ ray * distance, axes @ np.diag(sigmas**2) @ axes.T


def bearing_of_box(box: Array, camera: CameraModel, R_body_camera: Array) -> tuple[float, float, float]:
    """Bearing, elevation (down) and the standard deviation of both [rad] of a box without depth."""
    x, y, z = R_body_camera @ viewing_ray(box, camera)
    widest = max((box[2] - box[0]) / camera.fx, (box[3] - box[1]) / camera.fy)
    share = 1.0 if any(is_cut(box, camera)) else 0.5
    return float(np.arctan2(y, x)), float(np.arcsin(np.clip(-z, -1.0, 1.0))), float(share * UNIFORM * widest)


def is_cut(box: Array, camera: CameraModel) -> tuple[bool, bool]:
    """Whether the picture's edge cuts a (4,) box at the left or right, and above or below."""
    sideways = box[0] <= EDGE_PX or box[2] >= camera.width - EDGE_PX
    return bool(sideways), bool(box[1] <= EDGE_PX or box[3] >= camera.height - EDGE_PX)
