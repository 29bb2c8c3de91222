"""Conversion of keyframes to steps of the engine in space."""

from dataclasses import replace
from typing import ClassVar

import numpy as np

from semantic_slam.errors import InputError
from semantic_slam.geometry import se3
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.sightline import LEAST_DISTANCE_M, point_of_place
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.inference.inputs.score_features import FeatureReader
from semantic_slam.inference.inputs.vector_reader import VectorReader
from semantic_slam.inference.inputs.word_reader import WordReader
from semantic_slam.inference.models.detector_words import DetectorWords
from semantic_slam.inference.models.noise.configured_noise import ConfiguredNoise
from semantic_slam.inference.models.spatial.camera import LOOKS_AHEAD, Camera
from semantic_slam.inference.models.spatial.detection import SpatialDetection, across
from semantic_slam.inference.models.spatial.gravity import Gravity
from semantic_slam.inference.models.spatial.unmeasured_ranges import UnmeasuredRanges, log_angle
from semantic_slam.inference.models.step import Motion, Step
from semantic_slam.perception.image_sight import ImageSight
from semantic_slam.perception.measurement import SemanticMeasurements


class SpatialReader:
    """Reads motions in SE(3), and detections as range and ray, or as a ray alone.

    ``words`` reads the detector's labels and ``vectors`` appearance vectors, where these are evidence, and ``features``
    the features that class models need; ``ranges`` is the prior of a range that was not measured.
    """

    STATE: ClassVar[tuple[str, ...]] = ("_vectors",)

    def __init__(
        self,
        noise: ConfiguredNoise,
        words: WordReader | None = None,
        ranges: UnmeasuredRanges | None = None,
        features: FeatureReader | None = None,
        vectors: VectorReader | None = None,
    ) -> None:
        self._noise, self._ranges = noise, ranges or UnmeasuredRanges()
        self._words, self._vectors = words, vectors
        self._features = features or FeatureReader()

    def step(self, keyframe: Keyframe) -> Step:
        """The step of a keyframe. Raises InputError for detections without a usable position or direction in space."""
        measurements = self._features.with_features(keyframe.measurements)
        places, rays = zip(*points_of(measurements), strict=True), zip(*rays_of(measurements), strict=True)
        detections = [
            self._at_point(measurements, row, *place)
            if np.isfinite(place[0]).all()
            else self._along_ray(measurements, row, *ray)
            for row, (place, ray) in enumerate(zip(places, rays, strict=True))
        ]
        return Step(
            index=keyframe.index,
            stamp_ns=keyframe.stamp_ns,
            motion=self._motion(keyframe),
            detections=detections,
            detection_ids=measurements.detection_ids,
            scores=measurements.scores,
            names=measurements.track_ids,
            labels=measurements.labels,
            words=None if self._words is None else self._told_words(self._words, measurements, detections),
            vectors=None if self._vectors is None else self._vectors.vectors(keyframe),
            camera=camera_of(measurements),
            in_coverage=measurements.in_coverage,
            dropped=measurements.dropped,
        )

    def _told_words(
        self, reader: WordReader, measurements: SemanticMeasurements, detections: list[SpatialDetection]
    ) -> DetectorWords:
        """The detector's words, with the box sizes of detections without range, for which they are evidence."""
        angles = [
            np.nan if own.has_range else log_angle(measurements.angular_sizes_rad[n])
            for n, own in enumerate(detections)
        ]
        return replace(reader.words(measurements), log_angles=np.array(angles))

    def _motion(self, keyframe: Keyframe) -> Motion:
        """Raises InputError."""
        control, told = keyframe.odometry, keyframe.odometry_covariance
        if not se3.is_pose(control):
            raise InputError(
                f"keyframe {keyframe.index}: its odometry is no pose; give x y z [m] and a quaternion of unit length"
            )
        control = se3.wrapped(control)
        covariance = self._noise.of_motion_in_space(control, told)[se3.TO_MESSAGE][:, se3.TO_MESSAGE]
        return Motion(control, covariance, gravity=Gravity.of(keyframe.level))

    def _at_point(self, measurements: SemanticMeasurements, row: int, point: Array, slopes: Array) -> SpatialDetection:
        """Raises InputError."""
        distance = float(np.linalg.norm(point))
        if not distance >= LEAST_DISTANCE_M:
            raise InputError(
                f"{_which(measurements, row)} is where the body is; leave out what has no direction from there"
            )
        ray = point / distance
        told = self._told(measurements, row, slopes)
        if told is None:
            covariance = self._noise.of_detection_in_space(distance)
        else:
            polar = np.vstack([ray, across(ray).T / distance])
            covariance = polar @ told @ polar.T
        return SpatialDetection(
            ray=ray,
            range_m=distance,
            covariance=0.5 * (covariance + covariance.T),
            sensor=measurements.sensor_position,
            feature=measurements.features[row],
            feature_covariance=measurements.feature_covariances[row],
        )

    def _along_ray(self, measurements: SemanticMeasurements, row: int, ray: Array, slopes: Array) -> SpatialDetection:
        """Raises InputError."""
        if not np.isfinite(ray).all():
            raise InputError(f"{_which(measurements, row)} has neither range nor bearing; leave it out")
        covariance, told = self._noise.of_detection_in_space(0.0), measurements.place_covariances[row, 1:, 1:]
        covariance[0], covariance[:, 0] = np.nan, np.nan
        if np.isfinite(told).all():
            aside = across(ray).T @ slopes[:, 1:]
            spread = aside @ told @ aside.T
            covariance[1:, 1:] = 0.5 * (spread + spread.T)
        return SpatialDetection(
            ray=ray,
            range_m=np.nan,
            covariance=covariance,
            sensor=measurements.sensor_position,
            log_range=self._ranges.of_detection(measurements.labels[row], measurements.angular_sizes_rad[row]),
            feature=measurements.features[row],
            feature_covariance=measurements.feature_covariances[row],
        )

    def _told(self, measurements: SemanticMeasurements, row: int, slopes: Array) -> Array | None:
        """(3, 3) covariance of the point along the body's axes; None if it is not stated. Raises InputError."""
        of_point, of_place = measurements.point_covariances[row], measurements.place_covariances[row]
        if np.isfinite(of_point).all():
            return np.asarray(of_point)
        if np.isfinite(of_place).all():
            return np.asarray(slopes @ of_place @ slopes.T)
        if np.isfinite(measurements.geometric_covariances[row]).any():
            raise InputError(
                f"{_which(measurements, row)} has a covariance of range and bearing alone; state_space: spatial needs"
                " that of [range, bearing, elevation], or none"
            )
        return None


def camera_of(measurements: SemanticMeasurements) -> Camera:
    """The camera's mounting pose and sight; its optical axis is the body's x if no orientation is stated."""
    turn = measurements.sensor_orientation
    turn = turn if np.isfinite(turn).all() else LOOKS_AHEAD[3:]
    pose = np.concatenate([measurements.sensor_position, turn])
    return Camera(pose, ImageSight.told(measurements.image_edges_rad, measurements.free_ranges_m))


def _which(measurements: SemanticMeasurements, row: int) -> str:
    return f"detection {measurements.detection_ids[row]} at {measurements.stamp_ns} ns"


def rays_of(measurements: SemanticMeasurements) -> tuple[Array, Array]:
    """(D, 3) unit rays along the body's axes from bearing and elevation, NaN where these are not measured.

    The second array (D, 3, 3) holds Jacobians of their end points by range in the plane, bearing and elevation.
    """
    down = measurements.elevations_rad
    return point_of_place(np.stack([np.cos(down), measurements.bearings_rad, down], axis=1))


def points_of(measurements: SemanticMeasurements) -> tuple[Array, Array]:
    """(D, 3) points of detections in the body frame, NaN if not measured, and (D, 3, 3) Jacobians by measurements."""
    told = measurements.ranges_m, measurements.bearings_rad, measurements.elevations_rad
    points, slopes = point_of_place(np.stack(told, axis=1))
    as_points = np.isfinite(measurements.points).all(axis=1)
    points[as_points], slopes[as_points] = measurements.points[as_points], np.eye(3)
    return points, slopes
