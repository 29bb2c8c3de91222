"""Angular sizes of boxes: the angles between opposite edges, seen from the camera."""

import cv2
import numpy as np

from semantic_slam.geometry.arrays import Array, Flags
from semantic_slam.perception.frame import CameraModel

EDGES = np.array([[0.0, 0.5], [1.0, 0.5], [0.5, 0.0], [0.5, 1.0]])
"""Midpoints of a box's left, right, upper and lower edge, as fractions of its width and height."""


def angular_sizes(boxes: Array, cut: Flags, camera: CameraModel) -> Array:
    """(D, 2) width and height [rad] of (D, 4) boxes; NaN where ``cut`` (D, 2, 2) has an edge, or there is no box."""
    return np.where(cut.any(axis=2), np.nan, shown_sizes(boxes, camera))


def shown_sizes(boxes: Array, camera: CameraModel) -> Array:
    """(D, 2) width and height [rad] of the visible part of (D, 4) boxes; NaN where there is no box."""
    sizes = boxes[:, 2:] - boxes[:, :2]
    is_box = np.isfinite(boxes).all(axis=1) & (sizes > 0.0).all(axis=1)
    pixels = (boxes[is_box, None, :2] + EDGES * sizes[is_box, None]).reshape(-1, 2)
    rays = pixel_rays(pixels, camera).reshape(-1, 2, 2, 3)
    angles = np.full((len(boxes), 2), np.nan)
    angles[is_box] = np.arccos(np.clip((rays[:, :, 0] * rays[:, :, 1]).sum(axis=-1), -1.0, 1.0))
    return angles


def pixel_rays(pixels: Array, camera: CameraModel) -> Array:
    """(n, 3) unit rays of (n, 2) pixels in the optical frame, lens distortion removed."""
    if not len(pixels):
        return np.zeros((0, 3))
    intrinsics = np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])
    plane = cv2.undistortPoints(pixels[:, None], intrinsics, np.array(camera.distortion or (0.0,) * 4))
    rays = np.column_stack([plane.reshape(-1, 2), np.ones(len(pixels))])
    return np.asarray(rays / np.linalg.norm(rays, axis=1)[:, None])
