"""Conversion of keyframes to steps of the planar engine."""

from dataclasses import replace
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import planar_from_covariance, planar_from_pose_vector
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.inputs.score_features import FeatureReader
from semantic_slam.inference.inputs.vector_reader import VectorReader
from semantic_slam.inference.inputs.word_reader import WordReader
from semantic_slam.inference.models.noise.configured_noise import ConfiguredNoise
from semantic_slam.inference.models.odometry_bias import CLOCK, by_bias, slopes
from semantic_slam.inference.models.planar.detection import PlanarDetection
from semantic_slam.inference.models.sensed_region import SensedRegion
from semantic_slam.inference.models.step import Motion, Step
from semantic_slam.perception.measurement import SemanticMeasurements


class PlanarReader:
    """Reads x, y and yaw of motions and detections; ``num_features`` is what the class models need, 0 for none.

    ``bias_sigmas`` (4,) or empty: prior standard deviations of the odometry biases, where they are estimated, and
    ``bias_means`` (3,) their prior means; the mean of the clock offset is in the keyframes already.
    ``feature_names`` (F,) or empty: classes whose scores serve as features if no classifier has measured any.
    ``words`` reads the detector's labels and ``vectors`` appearance vectors, where these are evidence of classes.
    Where the region is learned up to ``region_within_m`` (0: anywhere), detections beyond are left out and counted.
    """

    STATE: ClassVar[tuple[str, ...]] = ("_sensed", "_num_beyond", "_vectors")

    def __init__(
        self,
        num_features: int,
        bias_sigmas: ArrayLike = (),
        feature_names: tuple[str, ...] = (),
        noise: ConfiguredNoise | None = None,
        *,
        bias_means: ArrayLike | None = None,
        learns_region: bool = False,
        region_within_m: float = 0.0,
        words: WordReader | None = None,
        vectors: VectorReader | None = None,
    ):
        self.bias_sigmas = np.asarray(bias_sigmas, dtype=np.float64)
        self.bias_means = np.zeros_like(self.bias_sigmas) if bias_means is None else np.asarray(bias_means, dtype=float)
        self._features, self.noise = FeatureReader(num_features, feature_names), noise or ConfiguredNoise()
        self._words, self._vectors = words, vectors
        self._sensed: list[SensedRegion | None] | None = [] if learns_region else None  # after each keyframe
        self._most_m = region_within_m if learns_region and region_within_m else float("inf")
        self._num_beyond: list[int] = []  # detections left out so far, after each keyframe

    def step(self, keyframe: Keyframe) -> Step:
        """The step of a keyframe. Raises InputError when the measurements' features do not match the class models."""
        keyframe = self._within(keyframe)
        measurements = self._features.with_features(keyframe.measurements)
        covariances = self.noise.of_detections(measurements.ranges_m, measurements.geometric_covariances)
        return Step(
            sensed=self._region_after(keyframe),
            index=keyframe.index,
            stamp_ns=keyframe.stamp_ns,
            motion=self._motion(keyframe),
            detections=[_detection(measurements, covariances, i) for i in range(len(measurements))],
            detection_ids=measurements.detection_ids,
            scores=measurements.scores,
            names=measurements.track_ids,
            labels=measurements.labels,
            words=None if self._words is None else self._words.words(measurements),
            vectors=None if self._vectors is None else self._vectors.vectors(keyframe),
            in_coverage=measurements.in_coverage,
            dropped=measurements.dropped,
            free_range_scan=measurements.free_range_scan,
        )

    def _within(self, keyframe: Keyframe) -> Keyframe:
        """The keyframe without detections beyond the range up to which the region is learned."""
        del self._num_beyond[keyframe.index :]  # the newest keyframe may be read again
        measurements, before = keyframe.measurements, self._num_beyond[-1] if self._num_beyond else 0
        is_beyond = measurements.ranges_m > self._most_m
        self._num_beyond.append(before + int(is_beyond.sum()))
        if not self._num_beyond[-1]:
            return keyframe
        kept = replace(
            measurements.take(np.flatnonzero(~is_beyond)), dropped=measurements.dropped + self._num_beyond[-1]
        )
        return replace(keyframe, measurements=kept)

    def _region_after(self, keyframe: Keyframe) -> SensedRegion | None:
        """The sensor region learned from all detections up to this keyframe; None where it is not learned."""
        if self._sensed is None:
            return None
        del self._sensed[keyframe.index :]  # the newest keyframe may be read again
        measurements, before = keyframe.measurements, self._sensed[-1] if self._sensed else None
        self._sensed.append(SensedRegion.of(measurements.ranges_m, measurements.bearings_rad, before, self._most_m))
        return self._sensed[-1]

    def _motion(self, keyframe: Keyframe) -> Motion:
        control = planar_from_pose_vector(keyframe.odometry)
        covariance = self.noise.of_motion(control, planar_from_covariance(keyframe.odometry_covariance))
        if not len(self.bias_sigmas):
            return Motion(control, covariance)
        told = slopes(control) if keyframe.odometry_slopes is None else keyframe.odometry_slopes
        expected = self.bias_means[:CLOCK]
        if expected.any():
            control = se2.retract(control, told @ expected)
        return Motion(control, covariance, by_bias(told, self.bias_sigmas), keyframe.odometry_shifts)


def _detection(measurements: SemanticMeasurements, covariances: Array, index: int) -> PlanarDetection:
    return PlanarDetection(
        range_m=float(measurements.ranges_m[index]),
        bearing_rad=float(measurements.bearings_rad[index]),
        covariance=covariances[index],
        sensor=measurements.sensor_position[:2],
        feature=measurements.features[index],
        feature_covariance=measurements.feature_covariances[index],
        elevation_rad=float(measurements.elevations_rad[index]),
    )
