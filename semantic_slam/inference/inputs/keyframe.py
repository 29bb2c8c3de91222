"""A keyframe: the odometry since the previous one and the measurements taken at it."""

import operator
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from semantic_slam.errors import InputError
from semantic_slam.foreign_numbers import as_numbers, is_finite
from semantic_slam.geometry import se3
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import covariance_from_planar, pose_vector_from_planar
from semantic_slam.inference.inputs.detection import Detection, positive_definite
from semantic_slam.perception.measurement import SemanticMeasurements

SECOND_NS = 10**9
"""Time in ns between keyframes that have no stamps."""
LIMIT = 1 << 63
"""Indices and stamps lie below this, which is what 64 bits with a sign hold."""


@dataclass(frozen=True)
class OdometrySample:
    """Pose of the body in the odom frame at one instant."""

    stamp_ns: int
    pose: Array  # (7,) T_odom_body: x y z qx qy qz qw
    covariance: Array | None = None  # (6, 6) x y z rx ry rz along the axes of odom, since its start; None: not stated


@dataclass(frozen=True, kw_only=True)
class Keyframe:
    """Input of the engine at one step: odometry since the previous keyframe, and measurements."""

    index: int  # 0, 1, 2, ... without a gap
    stamp_ns: int
    odometry: Array  # (7,) T_previous_current; from the first odometry sample for keyframe 0
    odometry_covariance: Array  # (6, 6) x y z rx ry rz, in the tangent space at the current pose; NaN: as configured
    measurements: SemanticMeasurements
    odometry_slopes: Array | None = None  # (3, 3) Jacobian of the planar motion by its biases; None: that of one arc
    odometry_shifts: Array | None = None  # (9, 3) changes of the planar motion by clock offsets; None: not stated
    level: Array | None = None  # (4,) direction of up in the body frame, and its variance [rad^2]; None: not measured
    is_level_to_come: bool = False  # ``level`` is not measured here, and an IMU is there to measure it later

    @classmethod
    def planar(
        cls,
        index: int,
        *,
        motion: ArrayLike = (0.0, 0.0, 0.0),
        detections: Sequence[Detection] = (),
        motion_sigmas: ArrayLike | None = None,
        stamp_ns: int | None = None,
    ) -> "Keyframe":
        """Keyframe of a robot in the plane: its detections after a ``motion`` x, y [m], yaw [rad] from the pose before.

        ``motion_sigmas``: standard deviations of x, y and yaw; None: the noise model ``odometry.*`` of the
        configuration. Without ``stamp_ns`` keyframes are a second apart. Raises InputError.
        """
        covariance = covariance_from_planar(_planar_covariance(motion_sigmas))
        return cls._of(index, pose_vector_from_planar(_three(motion, "motion")), covariance, detections, stamp_ns)

    @classmethod
    def spatial(
        cls,
        index: int,
        *,
        motion: ArrayLike = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0),
        detections: Sequence[Detection] = (),
        motion_covariance: ArrayLike | None = None,
        T_body_camera: ArrayLike | None = None,
        up: ArrayLike | None = None,
        sigma_up_rad: float = 0.02,
        stamp_ns: int | None = None,
    ) -> "Keyframe":
        """Keyframe of a robot in space: its detections after a ``motion`` x y z qx qy qz qw from the pose before.

        ``motion_covariance`` (6, 6) over x y z rx ry rz, along and about the axes of the body after the motion; None:
        the noise model ``odometry.*`` of the configuration. ``T_body_camera`` (7,) is the pose of the camera's optical
        frame, z ahead, in the body frame, which determines where misses count; None: it looks along the body's x.
        ``up`` (3,) is the direction against gravity in the body frame, by an accelerometer or an IMU, and
        ``sigma_up_rad`` its standard deviation about each of two axes orthogonal to it; None: it is not measured.
        Raises InputError.
        """
        pose = _pose(motion, "motion")
        covariance = np.full((6, 6), np.nan)
        if motion_covariance is not None:
            covariance = positive_definite(motion_covariance, 6, "keyframe: motion_covariance")
        keyframe = cls._of(index, pose, covariance, detections, stamp_ns)
        if up is not None:
            keyframe = replace(keyframe, level=_level(up, sigma_up_rad))
        if T_body_camera is None:
            return keyframe
        camera = _pose(T_body_camera, "T_body_camera")
        seen = replace(keyframe.measurements, sensor_position=camera[:3], sensor_orientation=camera[3:])
        return replace(keyframe, measurements=seen)

    @classmethod
    def _of(
        cls, index: int, motion: Array, covariance: Array, detections: Sequence[Detection], stamp_ns: int | None
    ) -> "Keyframe":
        index = _whole(index, "index")
        stamp_ns = _whole((index + 1) * SECOND_NS if stamp_ns is None else stamp_ns, "stamp_ns")
        if not (isinstance(detections, Sequence) and all(isinstance(seen, Detection) for seen in detections)):
            raise InputError("keyframe: detections are no list of Detection; give one, empty if there are none")
        return cls(
            index=index,
            stamp_ns=stamp_ns,
            odometry=motion,
            odometry_covariance=covariance,
            measurements=_measurements(index, stamp_ns, detections),
        )


def _whole(value: Any, what: str) -> int:
    """A whole number of 64 bits. Raises InputError."""
    try:
        number = operator.index(value)
    except TypeError:
        number = LIMIT
    if not -LIMIT <= number < LIMIT:
        raise InputError(f"keyframe: {what} is {value!r}; give a whole number of at most 64 bits")
    return number


def _pose(values: ArrayLike, what: str) -> Array:
    """(7,) with a quaternion of unit length. Raises InputError."""
    pose = as_numbers(values)
    if pose.shape != (7,) or not se3.is_pose(pose):
        raise InputError(f"keyframe: {what} is {values!r}; give x y z [m] and a quaternion of unit length")
    return se3.wrapped(pose)


def _level(up: ArrayLike, sigma_rad: float) -> Array:
    """(4,) as of ``Keyframe.level``. Raises InputError."""
    direction = as_numbers(up)
    if direction.shape != (3,) or not np.isfinite(direction).all() or not direction.any():
        raise InputError(f"keyframe: up is {up!r}; give the direction against gravity as x, y, z in the body frame")
    if not (is_finite(sigma_rad) and sigma_rad > 0.0):
        raise InputError(f"keyframe: sigma_up_rad is {sigma_rad!r}; a standard deviation must be above 0")
    return np.append(direction / np.linalg.norm(direction), sigma_rad**2)


def _three(values: ArrayLike, what: str) -> Array:
    numbers = as_numbers(values)
    if numbers.shape != (3,) or not np.isfinite(numbers).all():
        raise InputError(f"keyframe: {what} is {values!r}; give three finite numbers, of x, y [m] and yaw [rad]")
    return numbers


def _planar_covariance(sigmas: ArrayLike | None) -> Array:
    """(3, 3), NaN where it is left to the configuration."""
    if sigmas is None:
        return np.full((3, 3), np.nan)
    numbers = _three(sigmas, "motion_sigmas")
    if numbers.min() <= 0.0:
        raise InputError(f"keyframe: motion_sigmas are {sigmas!r}; standard deviations must be above 0")
    return np.diag(numbers**2)


def _measurements(index: int, stamp_ns: int, detections: Sequence[Detection]) -> SemanticMeasurements:
    """The detections in the form that perception outputs, without the results of a classifier."""
    count = len(detections)
    names = tuple(dict.fromkeys(name for detection in detections for name in detection.class_scores))
    scores = [[detection.class_scores.get(name, np.nan) for name in names] for detection in detections]
    return SemanticMeasurements(
        stamp_ns=stamp_ns,
        sequence=index,
        frame_id="base_link",
        class_names=names,
        detection_ids=np.arange(count, dtype=np.uint32),
        boxes=np.full((count, 4), np.nan),
        labels=tuple(detection.label for detection in detections),
        scores=np.array([detection.score for detection in detections], dtype=np.float64),
        track_ids=tuple(detection.track_id for detection in detections),
        class_probability_samples=np.zeros((count, 0, len(names))),
        features=np.zeros((count, 0)),
        feature_covariances=np.zeros((count, 0, 0)),
        predictive_entropy=np.full(count, np.nan),
        mutual_information=np.full(count, np.nan),
        ranges_m=np.array([np.nan if d.range_m is None else d.range_m for d in detections], dtype=np.float64),
        bearings_rad=np.array([detection.bearing_rad for detection in detections], dtype=np.float64),
        geometric_covariances=np.array([d.covariance_or_nan() for d in detections]).reshape(-1, 2, 2),
        sensor_position=np.zeros(3),
        elevations_rad=np.array([detection.elevation_rad for detection in detections], dtype=np.float64),
        place_covariances=_told_rows([detection.place_covariance for detection in detections], (3, 3)),
        points=_told_rows([detection.point for detection in detections], (3,)),
        point_covariances=_told_rows([detection.point_covariance for detection in detections], (3, 3)),
        in_coverage=np.ones(count, dtype=np.bool_),
        class_scores=np.array(scores, dtype=np.float64).reshape(count, len(names)),
        embeddings=_embeddings(detections),
        angular_sizes_rad=_told_rows([detection.angular_size_rad for detection in detections], (2,)),
    )


def _told_rows(values: Sequence[ArrayLike | None], shape: tuple[int, ...]) -> Array:
    """(D, *shape), NaN where a value is None."""
    rows = [np.full(shape, np.nan) if value is None else value for value in values]
    return np.array(rows, dtype=np.float64).reshape(-1, *shape)


def _embeddings(detections: Sequence[Detection]) -> Array:
    """(D, F), NaN where a detection has none. Raises InputError where they are of different lengths."""
    told = [np.asarray(detection.embedding, dtype=np.float64) for detection in detections]
    sizes = sorted({len(vector) for vector in told} - {0})
    if len(sizes) > 1:
        raise InputError(f"keyframe: embeddings of {sizes[0]} and of {sizes[-1]} components; use those of one network")
    size = sizes[0] if sizes else 0
    rows = [vector if len(vector) else np.full(size, np.nan) for vector in told]
    return np.array(rows, dtype=np.float64).reshape(len(detections), size)
