"""In-plane range, bearing and elevation of detections, with covariances, in the body frame."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.geometry.pose import rotated_by_matrix, rotation_matrix
from semantic_slam.geometry.rows import take
from semantic_slam.geometry.small_matrices import LEAST_VARIANCE, are_covariances
from semantic_slam.perception.boxes.box_rays import whole_box_rays
from semantic_slam.perception.crops import are_in_shares
from semantic_slam.perception.frame import CameraModel, Detections
from semantic_slam.perception.range_bearing import viewing_rays


@dataclass(frozen=True)
class Places:
    """Positions of D detections as range, bearing and elevation; NaN where not given."""

    ranges_m: Array  # (D,) in the x-y plane
    bearings_rad: Array  # (D,) counter-clockwise from x
    elevations_rad: Array  # (D,) downward angle of the line of sight
    covariances: Array  # (D, 3, 3) of range in the plane, bearing, elevation

    @classmethod
    def untold(cls, count: int) -> "Places":
        """All-NaN positions for ``count`` detections."""
        nothing = np.full(count, np.nan)
        return cls(nothing, nothing, nothing, np.full((count, 3, 3), np.nan))

    def take(self, rows: Index) -> "Places":
        """The selected positions."""
        return take(self, rows)

    def where(self, chosen: Flags, other: "Places") -> "Places":
        """Own positions where ``chosen`` (D,) is True, else those of ``other``."""
        return Places(
            np.where(chosen, self.ranges_m, other.ranges_m),
            np.where(chosen, self.bearings_rad, other.bearings_rad),
            np.where(chosen, self.elevations_rad, other.elevations_rad),
            np.where(chosen[:, None, None], self.covariances, other.covariances),
        )

    def are_covariances_usable(self) -> Flags:
        """(D,) whether the covariance of range and bearing is positive definite, or not given."""
        block = self.covariances[:, :2, :2]
        variances = np.diagonal(block, axis1=1, axis2=2)
        bearing_alone = np.isnan(self.ranges_m) & (variances[:, 1] >= LEAST_VARIANCE) & np.isfinite(variances[:, 1])
        return np.asarray(np.isnan(block).all(axis=(1, 2)) | are_covariances(block) | bearing_alone)


def told_places(detections: Detections) -> Places:
    """Positions carried by the detections themselves; range and bearing take precedence over a position."""
    if not np.isfinite(detections.bearings_rad).any() and np.isnan(detections.positions).all():
        return Places.untold(len(detections))
    ranged, positioned = places_of_ranges(detections), places_of_positions(detections)
    return ranged.where(np.isfinite(ranged.bearings_rad), positioned)


def places_of_ranges(detections: Detections) -> Places:
    """Convert distances, bearings and elevations; a missing elevation counts as zero.

    A distance r at elevation e is the in-plane range r cos(e); its covariance is propagated to first order.
    """
    elevations = np.nan_to_num(detections.elevations_rad, nan=0.0)
    distances = detections.ranges_m
    to_plane = np.tile(np.eye(3), (len(detections), 1, 1))
    to_plane[:, 0, 0] = np.cos(elevations)
    sways = np.isfinite(detections.place_covariances[:, 2, 2]) & np.isfinite(distances)
    to_plane[:, 0, 2] = -np.where(sways, distances, 0.0) * np.sin(elevations)
    return Places(
        distances * np.cos(elevations),
        detections.bearings_rad,
        detections.elevations_rad,
        _transformed(detections.place_covariances, to_plane),
    )


def places_of_positions(detections: Detections) -> Places:
    """Convert positions x y z [m]; covariances are propagated to first order."""
    x, y, z = detections.positions.T
    ranges = np.hypot(x, y)
    with np.errstate(divide="ignore", invalid="ignore"):
        squared = ranges**2 + z**2
        zero = np.zeros(len(x))
        polar = np.stack(
            [
                np.stack([x / ranges, y / ranges, zero], axis=-1),
                np.stack([-y / ranges**2, x / ranges**2, zero], axis=-1),
                np.stack([z * x / (ranges * squared), z * y / (ranges * squared), -ranges / squared], axis=-1),
            ],
            axis=1,
        )
        covariances = _transformed(detections.position_covariances, polar)
    return Places(ranges, np.arctan2(y, x), np.arctan2(-z, ranges), covariances)


def places_of_boxes(boxes: Array, cut: Flags | None, camera: CameraModel, T_base_camera: Array) -> Places:
    """Bearings and elevations of the centres of (D, 4) boxes, from the camera; NaN where there is no box.

    ``cut``: (D, 2, 2) edges beyond which boxes are extended; None: boxes are taken as they are.
    """
    count = len(boxes)
    are_boxes = np.isfinite(boxes).all(axis=1) & (boxes[:, 2:] > boxes[:, :2]).all(axis=1) & ~are_in_shares(boxes)
    directions = np.full((count, 3), np.nan)
    shown = boxes[are_boxes]
    rays = viewing_rays(shown, camera) if cut is None else whole_box_rays(shown, cut[are_boxes], camera)
    directions[are_boxes] = rotated_by_matrix(rotation_matrix(T_base_camera[3:]), rays)
    x, y, z = directions.T
    elevations = np.arcsin(np.clip(-z, -1.0, 1.0))
    return Places(np.full(count, np.nan), np.arctan2(y, x), elevations, np.full((count, 3, 3), np.nan))


def _transformed(covariances: Array, jacobians: Array) -> Array:
    """(D, 3, 3) propagated covariances J C J^T; NaN where an entry depends on one that is not given."""
    unknown, used = np.isnan(covariances), (jacobians != 0.0).astype(np.float64)
    moved = jacobians @ np.where(unknown, 0.0, covariances) @ np.swapaxes(jacobians, 1, 2)
    hidden = used @ unknown.astype(np.float64) @ np.swapaxes(used, 1, 2) > 0.0
    return np.asarray(np.where(hidden, np.nan, moved))
