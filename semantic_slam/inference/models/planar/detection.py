"""Detections of the planar observation model: single ones, and as arrays."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import log, sqrt
from typing import Any

import gtsam
import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.log_space import LOG_2PI
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.geometry.rows import Selection, take
from semantic_slam.inference.models.noise.noise_settings import NoiseSettings
from semantic_slam.inference.models.planar.depth_ranges import WIDEST_RAD, distance_per_depth

ASSUMED_RANGE_M = 3.0
"""Range [m] assumed for a bearing alone where the distance between detections matters."""


@dataclass(frozen=True, kw_only=True)
class PlanarDetection:
    """One detection, in the body frame."""

    range_m: float  # NaN: bearing only
    bearing_rad: float  # seen from the body's origin, or from ``sensor`` when bearing only
    covariance: Array  # (2, 2) of [range, bearing]
    sensor: Array  # (2,) camera in the body frame, metres
    feature: Array  # (F,) z_sem
    feature_covariance: Array  # (F, F) covariance of the dropout samples
    elevation_rad: float = 0.0  # of the camera over the object, from the box

    @cached_property
    def has_range(self) -> bool:
        return bool(np.isfinite(self.range_m))

    @property
    def turn_variance(self) -> float:
        """[rad^2] of the direction; infinite for a bearing alone."""
        return float(self.covariance[1, 1]) if self.has_range else np.inf

    @cached_property
    def whiten(self) -> Array:
        """(2, 2) matrix that whitens residuals of [range, bearing]; a missing range has a zero row."""
        (a, b), (_, c) = self.covariance.tolist()
        if not self.has_range:
            return np.array([[0.0, 0.0], [0.0, 1.0 / sqrt(c)]])
        first, below = sqrt(a), b / sqrt(a)
        second = sqrt(c - below**2)  # of the lower Cholesky factor
        return np.array([[1.0 / first, 0.0], [-below / (first * second), 1.0 / second]])

    @cached_property
    def log_normaliser(self) -> float:
        """Log normaliser of the Gaussian density of range and bearing, or of the bearing alone, in nats."""
        (by_range, _), (_, by_bearing) = self.whiten.tolist()
        return log(by_bearing) - 0.5 * LOG_2PI + (log(by_range) - 0.5 * LOG_2PI if self.has_range else 0.0)

    @cached_property
    def noise(self) -> Any:
        """GTSAM's noise model, in its order: bearing, range."""
        return gtsam.noiseModel.Gaussian.Covariance(self.covariance[::-1, ::-1])

    @cached_property
    def direction(self) -> Any:
        """The bearing as GTSAM has it."""
        return gtsam.Rot2.fromAngle(self.bearing_rad)

    @cached_property
    def feature_variance(self) -> Array:
        """(F,) diagonal of the feature's covariance."""
        return np.array(self.feature_covariance.diagonal())

    def widened(self, width: float) -> "PlanarDetection":
        """The detection with ``width`` times the error; cached, so that the result is one object per width."""
        if width not in self._widened:
            self._widened[width] = replace(self, covariance=width**2 * self.covariance)
        return self._widened[width]

    @cached_property
    def _widened(self) -> dict[float, "PlanarDetection"]:
        return {}

    @cached_property
    def _taken(self) -> dict[tuple[float, bool, float], "PlanarDetection"]:
        return {}

    def taken_as(self, settings: NoiseSettings) -> "PlanarDetection":
        """The detection under a hypothesis's noise settings; cached, so that the result is one object per setting."""
        key = (settings.detection_factor, settings.ranges_are_depth, settings.axis_rad)
        if key not in self._taken:
            scaled = replace(self, covariance=settings.detection_factor * self.covariance)
            self._taken[key] = scaled._along(settings.axis_rad) if settings.ranges_are_depth else scaled
        return self._taken[key]

    def _along(self, axis_rad: float) -> "PlanarDetection":
        """The detection with its range converted from depth along the axis to distance; unchanged far off the axis.

        The bearing's error is one of the distance, too: d = z / cos b, so that dd/dz = 1 / cos b, dd/db = d tan b.
        """
        if not self.has_range or abs(self._off(axis_rad)) >= WIDEST_RAD:
            return self
        slope = self._per_depth(axis_rad)
        distance = slope * self.range_m
        change = np.array([[slope, distance * np.tan(self.bearing_rad - axis_rad)], [0.0, 1.0]])
        return replace(self, range_m=distance, covariance=change @ self.covariance @ change.T)

    def log_change(self, settings: NoiseSettings) -> float:
        """Log ratio of the density as measured to that of :meth:`taken_as`: the derivative of distance by depth."""
        return log(self._per_depth(settings.axis_rad)) if settings.ranges_are_depth else 0.0

    def _per_depth(self, axis_rad: float) -> float:
        """Distance per depth, 1 for a bearing alone."""
        return float(distance_per_depth(np.array(self._off(axis_rad)))) if self.has_range else 1.0

    def _off(self, axis_rad: float) -> float:
        return float(wrap_angle(np.array(self.bearing_rad - axis_rad)))

    @property
    def place(self) -> Array:
        """(2,) measured position in the body frame; a bearing alone is placed at :data:`ASSUMED_RANGE_M`."""
        reach = self.range_m if self.has_range else ASSUMED_RANGE_M
        return self.origin + reach * np.array([np.cos(self.bearing_rad), np.sin(self.bearing_rad)])

    @property
    def origin(self) -> Array:
        """(2,) point of the body that range and bearing are seen from."""
        return np.zeros(2) if self.has_range else self.sensor


@dataclass(frozen=True, kw_only=True)
class PlanarDetections:
    """B detections as arrays; the range of a bearing alone has no effect. One row stands for any number."""

    range_m: Array  # (B,) 0 where there is none
    bearing_rad: Array  # (B,)
    whiten: Array  # (B, 2, 2) residuals of [range, bearing] to unit covariance, no row for a range that is missing
    log_normaliser: Array  # (B,) of the geometric density
    has_range: NDArray[np.bool_]  # (B,)
    origin: Array  # (B, 2)
    sensor: Array  # (B, 2)
    feature: Array  # (B, F)
    feature_covariance: Array  # (B, F, F)
    log_outlier: Array  # (B,) log density of the feature as an outlier, 0 where none is one

    @classmethod
    def of(cls, detections: Sequence[PlanarDetection]) -> "PlanarDetections":
        """All detections of a keyframe, or of a track."""
        count, size = len(detections), detections[0].feature.size if detections else 0
        scalars = [(item.range_m, item.bearing_rad, item.log_normaliser) for item in detections]
        range_m, bearing, log_normaliser = np.array(scalars).reshape(count, 3).T.copy()
        has_range = np.isfinite(range_m)
        range_m[~has_range] = 0.0
        sensor = np.array([item.sensor for item in detections]).reshape(count, 2)
        return cls(
            range_m=range_m,
            bearing_rad=bearing,
            whiten=np.array([item.whiten for item in detections]).reshape(count, 2, 2),
            log_normaliser=log_normaliser,
            has_range=has_range,
            origin=np.where(has_range[:, None], 0.0, sensor),
            sensor=sensor,
            feature=np.array([item.feature for item in detections]).reshape(count, size),
            feature_covariance=np.array([item.feature_covariance for item in detections]).reshape(count, size, size),
            log_outlier=np.zeros(count),
        )

    def take(self, index: Selection) -> "PlanarDetections":
        """Rows of a selection."""
        return take(self, index)
