"""Semantic measurements from detections that carry positions themselves, without an image.

A position is given as a range and a bearing, as a point in the body frame, or as the box of a detector whose camera is
known (then only the bearing of the box centre). Where the noise is not given, the covariance is NaN and the
configuration decides.
"""

from collections import Counter
from dataclasses import replace

import numpy as np

from semantic_slam.configuration import PerceptionConfiguration
from semantic_slam.geometry.arrays import Array, Flags
from semantic_slam.geometry.pose import rotation_matrix, transform_points
from semantic_slam.perception.best_scored import best_scored
from semantic_slam.perception.crops import IN_SHARES, are_in_shares
from semantic_slam.perception.cut_edges import cut_by_border, none_cut
from semantic_slam.perception.frame import CameraModel, Detections
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.perception.places_geometry import Places, places_of_boxes, told_places
from semantic_slam.perception.points_in_space import SpatialPoints, told_points, with_points
from semantic_slam.reasons import count, quoted

NO_PLACE = "detection without a place: neither range and bearing, nor position, nor a box that a known camera saw"
BAD_RANGE = "range that is not above zero"
BAD_COVARIANCE = "covariance of a place that is not positive definite"


class PlaceReader:
    """Measures detections by their reported positions; ``dropped`` counts unusable ones by reason."""

    def __init__(self, settings: PerceptionConfiguration, *, in_space: bool = False) -> None:
        """``in_space``: positions are also reported as 3-D points."""
        self._settings, self._in_space = settings, in_space
        self.dropped: Counter[str] = Counter()

    def measure(
        self,
        detections: Detections,
        sequence: int,
        camera: CameraModel | None = None,
        T_base_camera: Array | None = None,
    ) -> SemanticMeasurements:
        """Measure the usable detections; boxes need the ``camera`` and its (7,) pose in the body frame.

        Range and bearing are preferred to a position, and both to a box. In the plane, all bearings of a frame with
        either of the first two are relative to the body origin, so box-only detections are not used there; in space
        they are rays from the camera.
        """
        cut = cut_by_border(detections.boxes, camera) if self._in_space and camera is not None else None
        places, sensor = _places(detections, cut, camera, T_base_camera, in_space=self._in_space)
        points = told_points(detections) if self._in_space else SpatialPoints.untold(len(detections))
        if points.are_told.any():
            places = points.places.where(points.are_told, places)
        usable = np.flatnonzero(self._usable(detections, places, points))
        kept = best_scored(usable, detections.scores, self._settings.max_detections, self.dropped)
        places, rows, points = places.take(kept), detections.take(kept), points.take(kept)
        measured = SemanticMeasurements(
            stamp_ns=detections.stamp_ns,
            sequence=sequence,
            frame_id=self._settings.base_frame,
            class_names=detections.class_names,
            detection_ids=kept.astype(np.uint32),
            boxes=rows.boxes,
            labels=rows.labels,
            scores=rows.scores.astype(np.float64),
            track_ids=rows.track_ids,
            class_probability_samples=np.zeros((len(kept), 0, len(detections.class_names))),
            features=np.zeros((len(kept), 0)),
            feature_covariances=np.zeros((len(kept), 0, 0)),
            predictive_entropy=np.full(len(kept), np.nan),
            mutual_information=np.full(len(kept), np.nan),
            ranges_m=places.ranges_m,
            bearings_rad=places.bearings_rad,
            geometric_covariances=places.covariances[:, :2, :2],
            sensor_position=sensor,
            in_coverage=np.ones(len(kept), dtype=np.bool_),
            dropped=self.dropped.total(),
            elevations_rad=np.nan_to_num(places.elevations_rad, nan=0.0),
            place_covariances=places.covariances,
            class_scores=rows.class_scores,
            embeddings=rows.embeddings,
        )
        if not self._in_space:
            return measured
        mounted = self._settings.extrinsics if T_base_camera is None else T_base_camera
        cut = none_cut(len(kept)) if cut is None else cut[kept]
        return with_points(measured, points, cut, mounted, camera, self._settings)

    def _usable(self, detections: Detections, places: Places, points: SpatialPoints) -> Flags:
        """(D,) whether each detection is usable; the others are counted by their first reason."""
        faults = {
            IN_SHARES: are_in_shares(detections.boxes) & ~np.isfinite(places.bearings_rad),
            NO_PLACE: ~np.isfinite(places.bearings_rad) | np.isinf(places.ranges_m),
            BAD_RANGE: places.ranges_m <= 0.0,
            BAD_COVARIANCE: ~(places.are_covariances_usable() & points.are_covariances_usable()),
        }
        usable = self._have_known_labels(detections)
        for reason, rows in faults.items():
            self.dropped[reason] += int((usable & rows).sum())
            usable &= ~rows
        self.dropped += Counter()  # removes reasons with count zero
        return usable

    def _have_known_labels(self, detections: Detections) -> Flags:
        """(D,) whether each detection's label is one of ``perception.labels``; the others are counted."""
        known = self._settings.labels
        found = np.array([not known or label in known for label in detections.labels], dtype=np.bool_)
        for row in np.flatnonzero(~found):
            count(self.dropped, f"unknown label {quoted(detections.labels[row])}")
        return found


def in_body_frame(detections: Detections, T_base_frame: Array, base_frame: str) -> Detections:
    """Transform positions (D, 3) with covariances (D, 3, 3) from a sensor frame, of (7,) pose, to the body frame."""
    rotation = rotation_matrix(T_base_frame[3:])
    return replace(
        detections,
        frame_id=base_frame,
        positions=transform_points(T_base_frame, detections.positions),
        position_covariances=np.asarray(rotation @ detections.position_covariances @ rotation.T),
    )


def _places(
    detections: Detections,
    cut: Flags | None,
    camera: CameraModel | None,
    T_base_camera: Array | None,
    *,
    in_space: bool,
) -> tuple[Places, Array]:
    """Positions of all detections, and the (3,) origin, in the body frame, of bearings without range.

    ``cut``: (D, 2, 2) edges beyond which boxes are extended. ``in_space``: boxes count beside positions.
    """
    places = told_places(detections)
    are_told = np.isfinite(places.bearings_rad)
    if camera is None or T_base_camera is None or (are_told.any() and not in_space):
        return places, np.zeros(3)
    shown = places_of_boxes(detections.boxes, cut, camera, T_base_camera)
    return places.where(are_told, shown), np.asarray(T_base_camera[:3], dtype=np.float64)
