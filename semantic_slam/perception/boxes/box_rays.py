"""How well boxes tell the directions of their objects.

A detector puts a box's centre wrong by a share of the box's size, besides what any direction is wrong by. A box that
the image's border cuts goes on beyond it: what a detector finds all the same shows a third at least, and if every share
from there on is as likely, the centre of the whole is off that of what shows, outwards, by 0.3 of it on average, with a
standard deviation of a quarter. That repeats while the border goes on cutting the thing: it counts four times as large,
so that sixteen views in a row tell as much as one does.

Both sides of a whole box count as the larger one: how its two errors differ is a guess, for the centre of a thing seen
from above or aslant is off that of its box by what it shows of its depth, either way; and a ray that errs alike in all
directions is one of GTSAM's own factors, many times as fast as one that Python works out.
"""

import numpy as np

from semantic_slam.configuration import PerceptionConfiguration
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import rotation_matrix
from semantic_slam.geometry.so3 import cross
from semantic_slam.perception.boxes.box_sizes import are_cut, pixel_rays, shown_sizes
from semantic_slam.perception.frame import CameraModel

CUT_SHIFT, CUT_SHARE = 0.3, 1.0
"""Shares of what a cut box shows by which the centre of the whole lies beyond, and that this errs by."""
DOWN = np.array([0.0, 1.0, 0.0])
"""In the optical frame."""


def ray_covariances(
    boxes: Array, camera: CameraModel, T_base_camera: Array, settings: PerceptionConfiguration
) -> tuple[Array, Array]:
    """(D, 3) unit rays through the centres of (D, 4) boxes and their (D, 3, 3) covariances, along the body's axes.

    Across the rays alone, that is; NaN where a box is none.
    """
    rays = pixel_rays(_centres(whole_boxes(boxes, camera)), camera)
    shown, cut = shown_sizes(boxes, camera), are_cut(boxes, camera).any(axis=2)
    sizes = settings.box_centre_share * shown.max(axis=1, keepdims=True)
    variances = settings.sigma_bearing_rad**2 + np.where(cut, np.maximum(CUT_SHARE * shown, sizes), sizes) ** 2
    across = cross(DOWN, rays)
    across /= np.linalg.norm(across, axis=1)[:, None]
    axes = np.stack([across, cross(rays, across)], axis=2)
    rotation = rotation_matrix(T_base_camera[3:])
    turned = rotation @ axes
    return rays @ rotation.T, np.asarray((turned * variances[:, None]) @ np.swapaxes(turned, 1, 2))


def whole_boxes(boxes: Array, camera: CameraModel) -> Array:
    """(D, 4) boxes with what the image's border is taken to cut off; as they show where both borders cut."""
    cut, sizes = are_cut(boxes, camera), boxes[:, 2:] - boxes[:, :2]
    outwards = 2.0 * CUT_SHIFT * sizes
    low = np.where(cut[..., 0] & ~cut[..., 1], outwards, 0.0)
    high = np.where(cut[..., 1] & ~cut[..., 0], outwards, 0.0)
    return np.concatenate([boxes[:, :2] - low, boxes[:, 2:] + high], axis=1)


def _centres(boxes: Array) -> Array:
    return np.asarray(0.5 * (boxes[:, :2] + boxes[:, 2:]))


def as_places(rays: Array, covariances: Array) -> Array:
    """(D, 3, 3) of [range, bearing, elevation], NaN of the range, from unit rays (D, 3) and their covariances."""
    x, y, _ = rays.T
    level = x**2 + y**2
    slopes = np.zeros((len(rays), 2, 3))
    slopes[:, 0, 0], slopes[:, 0, 1], slopes[:, 1, 2] = -y / level, x / level, -1.0 / np.sqrt(level)
    found = np.full((len(rays), 3, 3), np.nan)
    found[:, 1:, 1:] = slopes @ covariances @ np.swapaxes(slopes, 1, 2)
    return found
