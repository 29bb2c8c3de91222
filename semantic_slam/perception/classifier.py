"""Classifier: from a frame to semantic measurements (crops, dropout passes or learned features, range, bearing)."""

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np

from semantic_slam.configuration import PerceptionConfiguration
from semantic_slam.geometry.arrays import Array, Flags
from semantic_slam.geometry.optional_arrays import left_out
from semantic_slam.perception import uncertainty
from semantic_slam.perception.best_scored import best_scored
from semantic_slam.perception.camera_sight import sight_of
from semantic_slam.perception.collaborators import (
    AppearanceCheck,
    CoverageCheck,
    FeatureExtractor,
    RangeBearingSensor,
    crop_features,
)
from semantic_slam.perception.crops import box_fault, square_crop
from semantic_slam.perception.cut_edges import cut_edges, none_cut
from semantic_slam.perception.frame import Detections, Frame
from semantic_slam.perception.free_range_scan import farthest_free_ranges
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.perception.places_geometry import Places, places_of_boxes, told_places
from semantic_slam.perception.points_in_space import SpatialPoints, points_of_boxes, told_points, with_points
from semantic_slam.perception.range_bearing import elevation
from semantic_slam.reasons import count, quoted

if TYPE_CHECKING:
    from semantic_slam.perception.networks.network import ClassifierNetwork


class Classifier:
    """Computes semantic measurements of a frame's detections; stateless but for its counters.

    ``dropped`` counts the detections that could not be used, by reason.
    """

    def __init__(
        self,
        network: "ClassifierNetwork | None",
        settings: PerceptionConfiguration,
        *,
        seed: int,
        range_bearing_sensor: RangeBearingSensor,
        extractor: FeatureExtractor | None = None,
        coverage: CoverageCheck | None = None,
        appearance: AppearanceCheck | None = None,
        in_space: bool = False,
    ) -> None:
        """Configure the parts; without ``extractor`` the class probabilities are the feature.

        A view is in coverage where neither ``coverage`` nor ``appearance`` calls it unknown. ``seed`` determines every
        dropout mask. Without ``network`` only the boxes' positions are measured, and the detector's labels and scores
        are passed on. ``in_space``: positions from boxes and depth are also reported as 3-D points.
        """
        self._network, self._settings, self._seed = network, settings, seed
        self._range_bearing_sensor, self._extractor = range_bearing_sensor, extractor
        self._coverage, self._appearance, self._in_space = coverage, appearance, in_space
        self.dropped: Counter[str] = Counter()

    @property
    def class_names(self) -> tuple[str, ...]:
        """(C,) class names of the class probability samples."""
        return self._network.class_names if self._network is not None else ()

    @property
    def num_features(self) -> int:
        """Number of feature components F: one per reported class, or those of a learned extractor."""
        if self._extractor is not None:
            return self._extractor.num_features
        return len(self._network.class_names) if self._network is not None else 0

    def measure(self, frame: Frame, sequence: int, T_base_frame: Array) -> SemanticMeasurements:
        """Measurements of the frame's usable detections; ``T_base_frame`` is the (7,) pose of the camera's frame."""
        T_base_camera = frame.camera.optical_pose(T_base_frame)
        usable = np.array(self._usable_detections(frame), dtype=np.intp)
        kept = best_scored(usable, frame.detections.scores, self._settings.max_detections, self.dropped).tolist()
        rows = frame.detections.take(np.array(kept, dtype=np.intp))
        boxes = rows.boxes.reshape(-1, 4)
        samples, total_entropy, model_part, recognised = self._dropout_samples(frame, kept)
        features, covariances = self._features(frame, boxes, samples)
        cut = self._cut_edges(frame, boxes)
        places, are_told, points = self._places(frame, rows, cut, T_base_camera)
        measured = SemanticMeasurements(
            stamp_ns=frame.stamp_ns,
            sequence=sequence,
            frame_id=self._settings.base_frame,
            class_names=self.class_names if self._network is not None else rows.class_names,
            detection_ids=np.array(kept, dtype=np.uint32),
            boxes=boxes,
            labels=rows.labels,
            scores=rows.scores.astype(np.float64),
            track_ids=rows.track_ids,
            class_probability_samples=samples,
            features=features,
            feature_covariances=covariances,
            predictive_entropy=total_entropy,
            mutual_information=model_part,
            ranges_m=places.ranges_m,
            bearings_rad=places.bearings_rad,
            geometric_covariances=places.covariances[:, :2, :2],
            sensor_position=np.asarray(T_base_camera[:3], dtype=np.float64),
            in_coverage=recognised & self._in_coverage(features, covariances),
            dropped=self.dropped.total(),
            free_range_scan=self._free_range_scan(frame, T_base_camera),
            free_ranges_m=self._free_ranges(frame, boxes),
            elevations_rad=places.elevations_rad,
            place_covariances=np.where(are_told[:, None, None], places.covariances, np.nan),
            class_scores=left_out() if self._network is not None else rows.class_scores,
            embeddings=rows.embeddings,
        )
        if not self._in_space:
            return measured
        return with_points(measured, points, cut, T_base_camera, frame.camera, self._settings)

    def _cut_edges(self, frame: Frame, boxes: Array) -> Flags:
        """(D, 2, 2) which edges of the boxes are cut; none in the plane, where it does not matter."""
        if not self._in_space:
            return none_cut(len(boxes))
        return cut_edges(boxes, frame.camera, frame.depth_m, self._settings.max_depth_m)

    def _places(
        self, frame: Frame, rows: Detections, cut: Flags, T_base_camera: Array
    ) -> tuple[Places, Flags, SpatialPoints]:
        """Positions reported by the detections (with a range), else from box and depth; and which ones are reported.

        In 3-D runs also the corresponding points, and boxes go on beyond the edges (D, 2, 2) that are ``cut``.
        """
        boxes = rows.boxes.reshape(-1, 4)
        sensed = [self._range_bearing_sensor(box, frame.depth_m, frame.camera, T_base_camera) for box in boxes]
        covariances = np.full((len(boxes), 3, 3), np.nan)
        covariances[:, :2, :2] = np.array([item.covariance for item in sensed], dtype=np.float64).reshape(-1, 2, 2)
        shown = Places(
            np.array([item.range_m for item in sensed], dtype=np.float64),
            np.array([item.bearing_rad for item in sensed], dtype=np.float64),
            np.array([elevation(box, frame.camera, T_base_camera) for box in boxes], dtype=np.float64),
            covariances,
        )
        told = told_places(rows)
        is_told = np.isfinite(told.bearings_rad) & (told.ranges_m > 0.0) & (told.ranges_m < np.inf)
        is_told &= told.are_covariances_usable()
        if not self._in_space:
            return told.where(is_told, shown), is_told, SpatialPoints.untold(len(boxes))
        distances = np.array([item.distance_m for item in sensed], dtype=np.float64)
        rays = places_of_boxes(boxes, cut, frame.camera, T_base_camera)
        shown = shown.where(np.isfinite(distances), rays)
        seen = points_of_boxes(boxes, cut, distances, frame.camera, T_base_camera, self._settings)
        own = told_points(rows)
        is_told |= own.are_told & own.are_covariances_usable()
        return told.where(is_told, shown), is_told, own.where(is_told, seen)

    def _free_range_scan(self, frame: Frame, T_base_camera: Array) -> Array:
        """(B, 2) bearing and range of the farthest surface in each direction; none without depth, or in space."""
        if frame.depth_m is None or self._in_space:
            return np.zeros((0, 2))
        return farthest_free_ranges(frame.depth_m, frame.camera, T_base_camera)

    def _free_ranges(self, frame: Frame, boxes: Array) -> Array:
        """(R, C) distance of the farthest surface in each direction; left out without depth, or in the plane."""
        if frame.depth_m is None or not self._in_space:
            return left_out()
        return sight_of(frame.camera, frame.depth_m, boxes).free_ranges_m

    def _features(self, frame: Frame, boxes: Array, samples: Array) -> tuple[Array, Array]:
        """(D, F) semantic features and (D, F, F) covariances over the passes; zero with a learned extractor."""
        if self._network is None:
            return np.zeros((len(boxes), 0)), np.zeros((len(boxes), 0, 0))
        if self._extractor is None:
            return samples.mean(axis=1), uncertainty.sample_covariance(samples)
        features = crop_features(self._extractor, frame.image, boxes)
        return features, np.zeros((*features.shape, features.shape[1]))

    def _in_coverage(self, features: Array, covariances: Array) -> Flags:
        """(D,) whether some class model explains the feature in some direction; True without a coverage check."""
        if self._coverage is None:
            return np.ones(len(features), dtype=np.bool_)
        rows = zip(features, covariances, strict=True)
        return np.array([self._coverage.explain(feature, covariance) for feature, covariance in rows], dtype=np.bool_)

    def _usable_detections(self, frame: Frame) -> list[int]:
        height, width = frame.image.shape[:2]
        kept = []
        for index, (box, label) in enumerate(zip(frame.detections.boxes, frame.detections.labels, strict=True)):
            fault = self._label_fault(label) or box_fault(box, width, height)
            if fault:
                count(self.dropped, fault)
            else:
                kept.append(index)
        return kept

    def _label_fault(self, label: str) -> str:
        known = self._settings.labels
        return f"unknown label {quoted(label)}" if known and label not in known else ""

    def _dropout_samples(self, frame: Frame, kept: list[int]) -> tuple[Array, Array, Array, Flags]:
        """(D, T, C) class samples, (D,) predictive entropy and mutual information, and (D,) recognition flags.

        The samples are of the reported classes, the uncertainties over all outputs; a flag says whether the crop looks
        like one of a known object.
        """
        recognised = np.ones(len(kept), dtype=np.bool_)
        if self._network is None:
            names = len(frame.detections.class_names)
            return np.zeros((len(kept), 0, names)), np.full(len(kept), np.nan), np.full(len(kept), np.nan), recognised
        # Deferred: PyTorch takes two seconds to import, and is not needed without a network.
        from semantic_slam.perception.networks.mc_dropout import dropout_generator, samples_of_head, seen

        network = self._network.network
        passes = self._settings.num_passes
        samples = np.empty((len(kept), passes, len(self.class_names)))
        total_entropy, model_part = np.empty(len(kept)), np.empty(len(kept))
        for row, index in enumerate(kept):
            crop = square_crop(frame.image, frame.detections.boxes[index], network.input_size)
            generator = dropout_generator(self._seed, frame.stamp_ns, index)
            once = seen(network, crop)
            whole = samples_of_head(network, once.descriptor, passes, generator)
            samples[row] = self._network.reported(whole)
            total_entropy[row] = uncertainty.predictive_entropy(whole)
            model_part[row] = uncertainty.mutual_information(whole)
            if self._appearance is not None:
                recognised[row] = self._appearance.recognise(once.appearance)
        return samples, total_entropy, model_part, recognised
