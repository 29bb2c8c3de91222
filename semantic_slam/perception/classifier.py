"""Frame in, semantic measurements out: crops, dropout passes or learned features, range and bearing."""

from collections import Counter
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from semantic_slam.configuration import Configuration
from semantic_slam.geometry.arrays import Array
from semantic_slam.latent.load import load_extractor
from semantic_slam.perception import uncertainty
from semantic_slam.perception.crops import box_fault, square_crop
from semantic_slam.perception.frame import Frame
from semantic_slam.perception.free_range_scan import line_of_sight
from semantic_slam.perception.mc_dropout import class_probability_samples, dropout_generator
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.perception.range_bearing import RangeBearing, elevation, range_and_bearing
from semantic_slam.perception.weights import load_network
from semantic_slam.viewpoint.gaussian_process import GaussianProcessModel
from semantic_slam.viewpoint.load import load_model
from semantic_slam.viewpoint.novelty import KnownViews

if TYPE_CHECKING:
    from semantic_slam.latent.extractor import FeatureExtractor


class Classifier:
    """Measures the detections of frames with the configured network; holds no state but its counters.

    ``dropped`` counts, by reason, the detections that could not be used.
    """

    def __init__(self, configuration: Configuration) -> None:
        """Load the network and the class models. Raises InputError when their files are missing or wrong."""
        self._configuration = configuration.perception
        self._seed = configuration.seed
        self._loaded = load_network(configuration.perception)
        self._extractor = load_extractor(configuration.semantic_model)
        model = load_model(configuration.semantic_model)
        self._known = KnownViews(model) if isinstance(model, GaussianProcessModel) else None
        self.dropped: Counter[str] = Counter()

    @property
    def class_names(self) -> tuple[str, ...]:
        """(C,) what the columns of the class probability samples mean."""
        return self._loaded.class_names

    @property
    def num_features(self) -> int:
        """F, components of the semantic feature: one per reported class, or those of a learned extractor."""
        return len(self._loaded.components) if self._extractor is None else self._extractor.num_features

    def measure(self, frame: Frame, sequence: int, T_base_camera: Array) -> SemanticMeasurements:
        """Measurements of the frame's usable detections; ``T_base_camera`` is the (7,) pose of the optical frame."""
        kept = self._usable_detections(frame)
        boxes = frame.detections.boxes[kept].reshape(-1, 4)
        samples, total_entropy, model_part = self._dropout_samples(frame, kept)
        features, covariances = self._features(frame, boxes, samples)
        geometry = [
            range_and_bearing(box, frame.depth_m, frame.camera, T_base_camera, self._configuration) for box in boxes
        ]
        return SemanticMeasurements(
            stamp_ns=frame.stamp_ns,
            sequence=sequence,
            frame_id=self._configuration.base_frame,
            class_names=self.class_names,
            detection_ids=np.array(kept, dtype=np.uint32),
            boxes=boxes,
            labels=tuple(frame.detections.labels[index] for index in kept),
            scores=frame.detections.scores[kept].astype(np.float64),
            track_ids=tuple(frame.detections.track_ids[index] for index in kept),
            class_probability_samples=samples,
            features=features,
            feature_covariances=covariances,
            predictive_entropy=total_entropy,
            mutual_information=model_part,
            ranges_m=np.array([item.range_m for item in geometry], dtype=np.float64),
            bearings_rad=np.array([item.bearing_rad for item in geometry], dtype=np.float64),
            geometric_covariances=_stacked_covariances(geometry),
            sensor_position=np.asarray(T_base_camera[:3], dtype=np.float64),
            in_coverage=self._in_coverage(features, covariances),
            dropped=self.dropped.total(),
            free_range_scan=_sight(frame, T_base_camera),
            elevations_rad=np.array([elevation(box, frame.camera, T_base_camera) for box in boxes]),
        )

    def _features(self, frame: Frame, boxes: Array, samples: Array) -> tuple[Array, Array]:
        """(D, F) semantic features and (D, F, F) their covariances: over the passes, none with a learned extractor."""
        if self._extractor is None:
            return samples.mean(axis=1), uncertainty.sample_covariance(samples)
        features = crop_features(self._extractor, frame.image, boxes)
        return features, np.zeros((*features.shape, features.shape[1]))

    def _in_coverage(self, features: Array, covariances: Array) -> NDArray[np.bool_]:
        """(D,) whether some class model shows such a feature in some direction; true without models to ask."""
        if self._known is None or self._known.num_features != self.num_features:
            return np.ones(len(features), dtype=np.bool_)
        rows = zip(features, covariances, strict=True)
        return np.array([self._known.explain(feature, covariance) for feature, covariance in rows], dtype=np.bool_)

    def _usable_detections(self, frame: Frame) -> list[int]:
        height, width = frame.image.shape[:2]
        kept = []
        for index, (box, label) in enumerate(zip(frame.detections.boxes, frame.detections.labels, strict=True)):
            fault = self._label_fault(label) or box_fault(box, width, height)
            if fault:
                self.dropped[fault] += 1
            else:
                kept.append(index)
        return kept

    def _label_fault(self, label: str) -> str:
        known = self._configuration.labels
        return f"unknown label '{label}'" if known and label not in known else ""

    def _dropout_samples(self, frame: Frame, kept: list[int]) -> tuple[Array, Array, Array]:
        """(D, T, C) samples of the reported components, and the two (D,) uncertainties over all outputs."""
        network, columns = self._loaded.network, list(self._loaded.components)
        passes = self._configuration.num_passes
        samples = np.empty((len(kept), passes, len(columns)))
        total_entropy, model_part = np.empty(len(kept)), np.empty(len(kept))
        for row, index in enumerate(kept):
            crop = square_crop(frame.image, frame.detections.boxes[index], network.input_size)
            generator = dropout_generator(self._seed, frame.stamp_ns, index)
            whole = class_probability_samples(network, crop, passes, generator)
            samples[row] = whole[:, columns]
            total_entropy[row] = uncertainty.predictive_entropy(whole)
            model_part[row] = uncertainty.mutual_information(whole)
        return samples, total_entropy, model_part


def crop_features(extractor: "FeatureExtractor", image: NDArray[np.uint8], boxes: Array) -> Array:
    """(D, F) learned features of the objects in (D, 4) boxes of an RGB image."""
    size = extractor.input_size
    crops = np.array([square_crop(image, box, size) for box in boxes], dtype=np.uint8)
    features: Array = extractor.features(crops.reshape(len(boxes), size, size, 3))
    return features


def _sight(frame: Frame, T_base_camera: Array) -> Array:
    """(B, 2), of no rows without depth."""
    return np.zeros((0, 2)) if frame.depth_m is None else line_of_sight(frame.depth_m, frame.camera, T_base_camera)


def _stacked_covariances(geometry: list[RangeBearing]) -> Array:
    return np.array([item.covariance for item in geometry], dtype=np.float64).reshape(-1, 2, 2)
