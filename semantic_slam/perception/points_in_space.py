"""3-D points of detections in the body frame, for runs that estimate six-degree-of-freedom poses."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from semantic_slam.configuration import PerceptionConfiguration
from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.geometry.pose import rotation_matrix
from semantic_slam.geometry.rows import take
from semantic_slam.geometry.sightline import in_plane, place_of_point
from semantic_slam.perception.boxes.box_rays import as_places, ray_covariances
from semantic_slam.perception.boxes.box_sizes import angular_sizes
from semantic_slam.perception.camera_sight import edges_of
from semantic_slam.perception.frame import CameraModel, Detections
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.perception.places_geometry import Places
from semantic_slam.perception.range_noise import range_variances


@dataclass(frozen=True)
class SpatialPoints:
    """D points with covariances; NaN where not given."""

    points: Array  # (D, 3) metres in the body frame
    covariances: Array  # (D, 3, 3) in the body frame

    @classmethod
    def untold(cls, count: int) -> "SpatialPoints":
        """All-NaN points for ``count`` detections."""
        return cls(np.full((count, 3), np.nan), np.full((count, 3, 3), np.nan))

    @property
    def are_told(self) -> Flags:
        """(D,) whether each point is given."""
        return np.asarray(np.isfinite(self.points).all(axis=1))

    def take(self, rows: Index) -> "SpatialPoints":
        """The selected points."""
        return take(self, rows)

    def where(self, chosen: Flags, other: "SpatialPoints") -> "SpatialPoints":
        """Own points where ``chosen`` (D,) is True, else those of ``other``."""
        return SpatialPoints(
            np.where(chosen[:, None], self.points, other.points),
            np.where(chosen[:, None, None], self.covariances, other.covariances),
        )

    def are_covariances_usable(self) -> Flags:
        """(D,) whether each covariance is symmetric and positive definite, or not given."""
        told = np.asarray(np.isfinite(self.covariances).all(axis=(1, 2)))
        if not told.any():
            return ~told
        known = np.where(told[:, None, None], self.covariances, np.eye(3))
        is_symmetric = np.isclose(known, np.swapaxes(known, 1, 2)).all(axis=(1, 2))
        return np.asarray(is_symmetric & (np.linalg.eigvalsh(known)[:, 0] > 0.0))

    @property
    def places(self) -> Places:
        """The points as in-plane ranges, bearings and elevations, for planar consumers."""
        ranges, bearings, elevations = place_of_point(self.points).T
        covariances = np.full((len(self.points), 3, 3), np.nan)
        for row in np.flatnonzero(np.isfinite(self.covariances).all(axis=(1, 2)) & self.are_told).tolist():
            covariances[row, :2, :2] = in_plane(self.points[row], self.covariances[row])
        return Places(ranges, bearings, elevations, covariances)


def told_points(detections: Detections) -> SpatialPoints:
    """Points from the detections' positions; NaN where range and bearing are given, which take precedence."""
    has_range = np.isfinite(detections.bearings_rad)
    positions = SpatialPoints(detections.positions, detections.position_covariances)
    return SpatialPoints.untold(len(detections)).where(has_range, positions)


def points_of_boxes(
    boxes: Array,
    cut: Flags,
    distances_m: Array,
    camera: CameraModel,
    T_base_camera: Array,
    settings: PerceptionConfiguration,
) -> SpatialPoints:
    """Points at given distances along the rays through (D, 4) boxes with cut edges (D, 2, 2); NaN without a distance.

    The error along the ray is that of ``perception.sigma_range_*``; across, that of the boxes.
    """
    rays, across = ray_covariances(boxes, cut, camera, T_base_camera, settings)
    along = rays[:, :, None] * rays[:, None, :]
    by_range = range_variances(distances_m, settings, rays @ rotation_matrix(T_base_camera[3:])[:, 2])
    covariances = by_range[:, None, None] * along + (distances_m**2)[:, None, None] * across
    return SpatialPoints(T_base_camera[:3] + rays * distances_m[:, None], covariances)


def with_points(
    measured: SemanticMeasurements,
    points: SpatialPoints,
    cut: Flags,
    T_base_camera: ArrayLike,
    camera: CameraModel | None,
    settings: PerceptionConfiguration,
) -> SemanticMeasurements:
    """Add points and the camera mounting pose, (7,), or empty where unknown, to measurements.

    ``cut``: (D, 2, 2) edges of their boxes that are cut. With a known ``camera``, angular sizes are added, ray
    covariances for boxes without a range, and the image's edges.
    """
    told: dict[str, Any] = {"points": points.points, "point_covariances": points.covariances}
    pose = np.asarray(T_base_camera, dtype=np.float64)
    if camera is not None:
        told["angular_sizes_rad"] = angular_sizes(measured.boxes, cut, camera)
    if len(pose):
        told |= {"sensor_position": pose[:3], "sensor_orientation": pose[3:] / np.linalg.norm(pose[3:])}
    if len(pose) and camera is not None:
        told["image_edges_rad"] = edges_of(camera)
    if len(pose) and camera is not None:
        told["place_covariances"] = _with_rays(measured, points, cut, camera, pose, settings)
    return replace(measured, **told)


def _with_rays(
    measured: SemanticMeasurements,
    points: SpatialPoints,
    cut: Flags,
    camera: CameraModel,
    pose: Array,
    settings: PerceptionConfiguration,
) -> Array:
    """(D, 3, 3) place covariances, with bearing and elevation filled in for boxes without a range."""
    untold = np.isnan(measured.place_covariances[:, 1, 1])
    alone = np.isnan(measured.ranges_m) & np.isnan(points.points[:, 0]) & untold
    shown = as_places(*ray_covariances(measured.boxes, cut, camera, pose, settings))
    return np.where(alone[:, None, None], shown, measured.place_covariances)
