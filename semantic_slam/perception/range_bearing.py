"""Range and bearing of detected objects in the robot's body frame, from boxes, depth and extrinsics."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semantic_slam.configuration import PerceptionConfiguration
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import rotated_by_matrix, rotation_matrix, transform_points
from semantic_slam.perception.boxes.box_sizes import pixel_rays
from semantic_slam.perception.frame import CameraModel

CENTRAL_FRACTION = 0.6
"""Central fraction of a box's width and height in which depth is read."""
DEPTH_PERCENTILE = 30.0
"""Percentile of the valid depths in a box; below the median, as background is only ever farther than the object."""
NOISE_SIGMAS, NOISE_STEPS = 1.5, 5
"""Half width, in standard deviations of stereo, of the window whose median replaces that percentile, and how often."""
LEAST_READINGS = 5
"""Smallest number of valid depth pixels at which a box has a depth."""


@dataclass(frozen=True)
class RangeBearing:
    """Geometric measurement of one object, in the x-y plane of the body frame."""

    range_m: float  # from the body's origin; NaN without depth
    bearing_rad: float  # counter-clockwise from x; from the body's origin with depth, from the camera without
    covariance: Array  # (2, 2) of [range, bearing]; its range entry is NaN without depth
    distance_m: float = float("nan")  # from the camera, along the viewing ray; NaN without depth


def viewing_ray(box: Array, camera: CameraModel) -> Array:
    """(3,) unit ray through the centre of a box, in the optical frame, lens distortion removed."""
    ray: Array = viewing_rays(box[None], camera)[0]
    return ray


def viewing_rays(boxes: Array, camera: CameraModel) -> Array:
    """(D, 3) unit rays through the centres of (D, 4) boxes, in the optical frame, lens distortion removed."""
    return pixel_rays(0.5 * (boxes[:, :2] + boxes[:, 2:]), camera)


def depth_in_box(depth_m: NDArray[np.float32], box: Array, max_depth_m: float, sigma_per_m2: float = 0.0) -> float:
    """Depth of the object's visible surface along the optical axis, metres; NaN when too few readings are valid.

    ``sigma_per_m2``: standard deviation of a depth per square metre of it, of stereo. A percentile below the median
    would be nearer than the surface by a share of the noise; so the median of depths about it takes its place.
    """
    height, width = depth_m.shape
    centre, half = 0.5 * (box[:2] + box[2:]), 0.5 * CENTRAL_FRACTION * (box[2:] - box[:2])
    low = np.clip(np.floor(centre - half), 0, (width, height)).astype(int)
    high = np.clip(np.ceil(centre + half), 0, (width, height)).astype(int)
    values = depth_m[low[1] : high[1], low[0] : high[0]]
    valid = values[np.isfinite(values) & (values > 0.0) & (values <= max_depth_m)]
    if valid.size < LEAST_READINGS:
        return float("nan")
    depth = float(np.percentile(valid, DEPTH_PERCENTILE))
    for _ in range(NOISE_STEPS if sigma_per_m2 > 0.0 else 0):
        near = valid[np.abs(valid - depth) <= NOISE_SIGMAS * sigma_per_m2 * depth**2]
        depth = float(np.median(near)) if near.size else depth
    return depth


def elevation(box: Array, camera: CameraModel, T_base_camera: Array) -> float:
    """Downward angle [rad] of the ray through the box centre, in the body frame: camera elevation over the object."""
    direction = rotated_by_matrix(rotation_matrix(T_base_camera[3:]), viewing_ray(box, camera))
    return float(np.arcsin(np.clip(-direction[2], -1.0, 1.0)))


def range_and_bearing(
    box: Array,
    depth_m: NDArray[np.float32] | None,
    camera: CameraModel,
    T_base_camera: Array,
    configuration: PerceptionConfiguration,
) -> RangeBearing:
    """Measurement of the object in ``box`` ((4,) pixels); ``T_base_camera`` is the (7,) pose of the optical frame.

    The object's centre is assumed behind its visible surface, along the viewing ray, by ``depth_to_width`` times its
    visible width. One half is right for a cylinder and for a square box seen face on or corner on.
    """
    ray = viewing_ray(box, camera)
    depth, noise = float("nan"), configuration.sigma_range_per_m2
    if depth_m is not None:
        depth = depth_in_box(depth_m, box, configuration.max_depth_m, noise)
    bearing_variance = configuration.sigma_bearing_rad**2
    if np.isnan(depth):
        direction = rotated_by_matrix(rotation_matrix(T_base_camera[3:]), ray)
        covariance = np.diag([np.nan, bearing_variance])
        return RangeBearing(float("nan"), float(np.arctan2(direction[1], direction[0])), covariance)
    width_m = (box[2] - box[0]) / camera.fx * depth
    distance = depth / ray[2] + configuration.depth_to_width * width_m
    centre_camera = ray * distance
    x, y, _ = transform_points(T_base_camera, centre_camera[None])[0]
    covariance = np.diag([configuration.sigma_range_m**2, bearing_variance])
    return RangeBearing(float(np.hypot(x, y)), float(np.arctan2(y, x)), covariance, float(distance))
