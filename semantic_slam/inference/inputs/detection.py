"""One detection of an object from the robot, as stated through the Python interface."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from semantic_slam.errors import InputError
from semantic_slam.foreign_numbers import as_numbers, is_finite
from semantic_slam.geometry import se3, so3
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.sightline import LEAST_DISTANCE_M, in_plane, place_of_point, point_of_place

_IDENTITY = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])


@dataclass(frozen=True, kw_only=True)
class Detection:
    """Range and bearing of an object's centre from the body's origin, or a bearing alone; x ahead, y to the left.

    In space (:meth:`along`, :meth:`in_space`) the range is that in the plane of x and y, beside an elevation.
    Raises InputError for numbers that cannot be measurements.
    """

    bearing_rad: float  # counter-clockwise from x
    range_m: float | None = None  # None: not measured
    covariance: ArrayLike | None = None  # (2, 2) of [range, bearing]; None: perception.sigma_* of the configuration
    class_scores: Mapping[str, float] = field(default_factory=dict)  # class -> score; the class models' features
    score: float = 1.0  # of the detection; the best-scored ones are used if there are more detections than objects
    track_id: str = ""  # identity of the object, for association: given
    label: str = ""  # class label from a detector
    elevation_rad: float = 0.0  # downwards from the plane of x and y
    place_covariance: ArrayLike | None = None  # (3, 3) of [range, bearing, elevation], in space, NaN of a range that is
    # not measured; None: as configured
    point: ArrayLike | None = None  # (3,) in the body frame [m]; what :meth:`along` and :meth:`in_space` fill in
    point_covariance: ArrayLike | None = (
        None  # (3, 3) along the axes of the body; None: place_covariance, or as configured
    )
    embedding: ArrayLike = ()  # appearance as a vector, of any length and unit; empty: none
    angular_size_rad: ArrayLike | None = (
        None  # (2,) width and height of its box as angles, NaN where cut; None: unknown
    )

    def __post_init__(self) -> None:
        if not isinstance(self.class_scores, Mapping):
            raise InputError(f"detection: class_scores is {self.class_scores!r}; give a score for each class")
        numbers = {
            "bearing_rad": self.bearing_rad,
            "elevation_rad": self.elevation_rad,
            "score": self.score,
            **dict(self.class_scores),
        }
        for name, value in numbers.items():
            if not is_finite(value):
                raise InputError(f"detection: {name} is {value!r}; leave detections out that have no such number")
        if self.range_m is not None and not _is_length(self.range_m):
            raise InputError(
                f"detection: range_m is {self.range_m!r}; give metres above 0, or None for a bearing alone"
            )
        if self.point is not None:
            _vector(self.point, 3, "detection: point")
        if self.point_covariance is not None:
            positive_definite(self.point_covariance, 3, "detection: point_covariance of [x, y, z]")
        vector = as_numbers(self.embedding)
        if vector.ndim != 1 or not np.isfinite(vector).all():
            raise InputError("detection: embedding must be one row of finite numbers; leave it out where there is none")
        if self.angular_size_rad is not None:
            self._check_size()
        if self.covariance is not None:
            positive_definite(self.covariance, 2, "detection: covariance of [range, bearing]")
        if self.place_covariance is not None:
            self._check_place_covariance()

    @classmethod
    def at(cls, x_m: float, y_m: float, *, covariance: ArrayLike | None = None, **others: Any) -> "Detection":
        """From a point in the body frame, with its (2, 2) covariance along x and y if known. Raises InputError."""
        if not (is_finite(x_m) and is_finite(y_m)):
            raise InputError(f"detection: x_m is {x_m!r} and y_m {y_m!r}; leave out what has no place in metres")
        distance = math.hypot(x_m, y_m)
        if covariance is not None and distance > 0.0:
            by_point = np.array([[x_m, y_m], [-y_m / distance, x_m / distance]]) / distance
            covariance = by_point @ positive_definite(covariance, 2, "detection: covariance of [x, y]") @ by_point.T
        return cls(range_m=distance, bearing_rad=math.atan2(y_m, x_m), covariance=covariance, **others)

    @classmethod
    def in_space(
        cls,
        point: ArrayLike,
        *,
        covariance: ArrayLike | None = None,
        T_body_sensor: ArrayLike | None = None,
        **others: Any,
    ) -> "Detection":
        """From a point (3,) in a sensor's frame, with its (3, 3) covariance along the axes of that frame if known.

        ``T_body_sensor`` (7,) is the pose of the sensor in the body frame; None: it is the body's.
        """
        seen = _vector(point, 3, "detection: point")
        pose = _sensor_pose(T_body_sensor)
        in_body = pose[:3] + so3.rotated(pose[3:], seen)
        if np.linalg.norm(in_body) < LEAST_DISTANCE_M:
            raise InputError(
                f"detection: point {point!r} is where the body is; leave out what has no direction from there"
            )
        if covariance is not None:
            turn = so3.matrix(pose[3:])
            known = turn @ positive_definite(covariance, 3, "detection: covariance of [x, y, z]") @ turn.T
            others |= {"point_covariance": known, "covariance": in_plane(in_body, known)}
        reach, bearing, down = place_of_point(in_body).tolist()
        return cls(range_m=reach, bearing_rad=bearing, elevation_rad=down, point=in_body, **others)

    @classmethod
    def along(
        cls,
        ray: ArrayLike,
        range_m: float | None = None,
        *,
        sigma_range_m: float | None = None,
        ray_covariance: ArrayLike | None = None,
        T_body_sensor: ArrayLike | None = None,
        **others: Any,
    ) -> "Detection":
        """From a ray (3,) in a sensor's frame, of any length, and the distance along it; None: not measured.

        ``ray_covariance`` (3, 3) is that of the unit ray along the axes of that frame; only its part orthogonal to the
        ray counts: sigma^2 I for sigma radians in every direction. If there is a range, it has to be given together
        with ``sigma_range_m``. A ray without range starts at the camera, whose position the keyframe states. Raises
        InputError.
        """
        direction = _vector(ray, 3, "detection: ray")
        length = float(np.linalg.norm(direction))
        if not (length > 0.0 and (range_m is None or _is_length(range_m))):
            raise InputError(f"detection: a ray of length {length} and a range of {range_m!r}; give lengths above 0")
        unit, covariance = direction / length, None
        if range_m is None:
            if sigma_range_m is not None:
                raise InputError("detection: sigma_range_m is of no range; give range_m too, or leave both out")
            return cls._of_ray(unit, ray_covariance, T_body_sensor, **others)
        if (sigma_range_m is None) != (ray_covariance is None):
            raise InputError("detection: give both sigma_range_m and ray_covariance, or none of them")
        if sigma_range_m is not None and ray_covariance is not None:
            if not _is_length(sigma_range_m):
                raise InputError(f"detection: sigma_range_m is {sigma_range_m!r}; give metres above 0")
            across = np.eye(3) - np.outer(unit, unit)
            spread = across @ _ray_covariance(ray_covariance) @ across
            covariance = sigma_range_m**2 * np.outer(unit, unit) + range_m**2 * spread
        return cls.in_space(range_m * unit, covariance=covariance, T_body_sensor=T_body_sensor, **others)

    @classmethod
    def _of_ray(
        cls, unit: Array, covariance: ArrayLike | None, T_body_sensor: ArrayLike | None, **others: Any
    ) -> "Detection":
        """A ray alone, along the body's axes: its covariance (3, 3) is that of bearing and elevation."""
        turn = so3.matrix(_sensor_pose(T_body_sensor)[3:])
        _, bearing, down = place_of_point(turn @ unit).tolist()
        if covariance is not None:
            seen, by_place = point_of_place(np.array([math.cos(down), bearing, down]))
            known = turn @ _ray_covariance(covariance) @ turn.T
            by_ray = np.linalg.pinv((np.eye(3) - np.outer(seen, seen)) @ by_place[:, 1:])
            place = np.full((3, 3), np.nan)
            spread = by_ray @ known @ by_ray.T
            place[1:, 1:] = positive_definite(0.5 * (spread + spread.T), 2, "detection: ray_covariance")
            others |= {"place_covariance": place}
        return cls(bearing_rad=bearing, elevation_rad=down, **others)

    def _check_size(self) -> None:
        """Raises InputError."""
        size = as_numbers(self.angular_size_rad)
        if size.shape != (2,) or (size <= 0.0).any() or np.isinf(size).any():
            raise InputError(
                f"detection: angular_size_rad is {self.angular_size_rad!r}; give width and height in radians above 0,"
                " NaN for one that is not known"
            )

    def _check_place_covariance(self) -> None:
        """Raises InputError; of a bearing alone bearing and elevation count."""
        known, what = as_numbers(self.place_covariance), "detection: place_covariance"
        if self.range_m is None and known.shape == (3, 3) and np.isnan(known[0]).all() and np.isnan(known[:, 0]).all():
            positive_definite(known[1:, 1:], 2, f"{what} of [bearing, elevation]")
            return
        positive_definite(known, 3, f"{what} of [range, bearing, elevation]")

    def covariance_or_nan(self) -> Array:
        """(2, 2) covariance of [range, bearing], NaN where it is not given."""
        if self.covariance is None:
            return np.full((2, 2), np.nan)
        known = np.array(self.covariance, dtype=np.float64)
        return known if self.range_m is not None else np.diag([np.nan, known[1, 1]])


def _sensor_pose(T_body_sensor: ArrayLike | None) -> Array:
    """(7,) of a sensor in the body frame; None: it is the body's. Raises InputError."""
    pose = _IDENTITY if T_body_sensor is None else _vector(T_body_sensor, 7, "detection: T_body_sensor")
    if not se3.is_pose(pose):
        raise InputError("detection: T_body_sensor has no quaternion of unit length; give x y z qx qy qz qw")
    return se3.wrapped(pose)


def _is_length(value: float) -> bool:
    """Whether a number is finite and above 0."""
    return is_finite(value) and value > 0.0


def _ray_covariance(values: ArrayLike) -> Array:
    """(3, 3) covariance of a unit ray; only its part orthogonal to the ray need be positive. Raises InputError."""
    matrix = as_numbers(values)
    if matrix.shape != (3, 3) or not np.isfinite(matrix).all() or not np.allclose(matrix, matrix.T):
        raise InputError(
            "detection: ray_covariance must be 3 x 3 finite numbers, symmetric; give sigma^2 I for sigma radians"
        )
    return matrix


def _vector(values: ArrayLike, size: int, what: str) -> Array:
    """(size,) finite numbers. Raises InputError that begins with ``what``."""
    vector = as_numbers(values)
    if vector.shape != (size,) or not np.isfinite(vector).all():
        raise InputError(f"{what} is {values!r}; give {size} finite numbers")
    return vector


def positive_definite(values: ArrayLike, size: int, what: str) -> Array:
    """(size, size) covariance; raises InputError that begins with ``what`` for anything else."""
    matrix = as_numbers(values)
    if matrix.shape != (size, size) or not np.isfinite(matrix).all():
        raise InputError(f"{what} must be {size} x {size} finite numbers; correct it")
    if not np.allclose(matrix, matrix.T) or np.linalg.eigvalsh(matrix).min() <= 0.0:
        raise InputError(f"{what} is not symmetric and positive definite; give variances above 0 on its diagonal")
    return matrix
