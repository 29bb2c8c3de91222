"""Directions of objects from their boxes: unit rays and their covariances.

The error of a box centre is proportional to the box size, plus a constant directional error. A box with a cut edge, by
the image border or by something nearer, continues beyond it. A detected cut box shows at least a third of the object;
with all visible fractions from there on equally likely, the true centre lies outwards of the visible centre by 0.3 of
the visible size on average, with a standard deviation of a quarter of it. This error persists while the object is cut,
so its standard deviation is taken four times as large: sixteen views in a row then count as one.

For a whole box, the larger side determines the error in both directions. How the two errors differ would be a guess:
seen from above or at an angle, an object's centre is displaced from the box centre by its visible depth, in either
direction. Besides, an isotropic ray error can use one of GTSAM's own factors, many times as fast as a Python factor.
"""

import numpy as np

from semantic_slam.configuration import PerceptionConfiguration
from semantic_slam.geometry.arrays import Array, Flags
from semantic_slam.geometry.pose import rotated_by_matrix, rotation_matrix
from semantic_slam.geometry.so3 import cross
from semantic_slam.perception.boxes.box_sizes import pixel_rays, shown_sizes
from semantic_slam.perception.frame import CameraModel

CUT_SHIFT, CUT_SHARE = 0.3, 1.0
"""Shift of a cut box's true centre towards the cut edge, and standard deviation, as shares of the visible size."""
DOWN = np.array([0.0, 1.0, 0.0])
"""Downward direction in the optical frame."""


def ray_covariances(
    boxes: Array, cut: Flags, camera: CameraModel, T_base_camera: Array, settings: PerceptionConfiguration
) -> tuple[Array, Array]:
    """(D, 3) unit rays through the centres of (D, 4) boxes and their (D, 3, 3) covariances, in the body frame.

    ``cut``: (D, 2, 2) edges that are cut, see :mod:`semantic_slam.perception.cut_edges`. The covariances are
    transverse to the rays only; NaN where there is no box.
    """
    rays = whole_box_rays(boxes, cut, camera)
    shown, are_cut = shown_sizes(boxes, camera), cut.any(axis=2)
    sizes = settings.box_centre_share * shown.max(axis=1, keepdims=True)
    variances = settings.sigma_bearing_rad**2 + np.where(are_cut, np.maximum(CUT_SHARE * shown, sizes), sizes) ** 2
    across = cross(DOWN, rays)
    across /= np.linalg.norm(across, axis=1)[:, None]
    axes = np.stack([across, cross(rays, across)], axis=2)
    rotation = rotation_matrix(T_base_camera[3:])
    turned = rotation @ axes
    return rotated_by_matrix(rotation, rays), np.asarray((turned * variances[:, None]) @ np.swapaxes(turned, 1, 2))


def whole_box_rays(boxes: Array, cut: Flags, camera: CameraModel) -> Array:
    """(D, 3) unit rays of the optical frame through the centres of (D, 4) boxes, extended beyond their cut edges."""
    return pixel_rays(_centres(_whole_boxes(boxes, cut)), camera)


def _whole_boxes(boxes: Array, cut: Flags) -> Array:
    """(D, 4) boxes extended by the part assumed hidden beyond a cut edge; unchanged where opposite edges are cut."""
    outwards = 2.0 * CUT_SHIFT * (boxes[:, 2:] - boxes[:, :2])
    low = np.where(cut[..., 0] & ~cut[..., 1], outwards, 0.0)
    high = np.where(cut[..., 1] & ~cut[..., 0], outwards, 0.0)
    return np.concatenate([boxes[:, :2] - low, boxes[:, 2:] + high], axis=1)


def _centres(boxes: Array) -> Array:
    return np.asarray(0.5 * (boxes[:, :2] + boxes[:, 2:]))


def as_places(rays: Array, covariances: Array) -> Array:
    """(D, 3, 3) covariances of [range, bearing, elevation], range NaN, from unit rays (D, 3) with covariances."""
    x, y, _ = rays.T
    level = x**2 + y**2
    slopes = np.zeros((len(rays), 2, 3))
    slopes[:, 0, 0], slopes[:, 0, 1], slopes[:, 1, 2] = -y / level, x / level, -1.0 / np.sqrt(level)
    found = np.full((len(rays), 3, 3), np.nan)
    found[:, 1:, 1:] = slopes @ covariances @ np.swapaxes(slopes, 1, 2)
    return found
