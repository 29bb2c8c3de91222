"""Detections of the observation model in space: single ones, and as arrays."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from math import sqrt
from typing import Any

import gtsam
import numpy as np

from semantic_slam.geometry.arrays import Array, Flags
from semantic_slam.geometry.log_space import LOG_2PI
from semantic_slam.geometry.rows import Selection, take
from semantic_slam.inference.models.spatial.log_range import ANYWHERE, LogRange

ROUND = 1e-9
"""Relative deviation of a ray's covariance from an isotropic one that is ignored."""


def across(ray: Array) -> Array:
    """(3, 2) orthonormal axes of the plane across a ray (3,), as GTSAM has them."""
    return np.asarray(gtsam.Unit3(ray).basis())


@dataclass(frozen=True, kw_only=True)
class SpatialDetection:
    """One detection, along the axes of the body: from the body's origin with a range, from the camera without."""

    ray: Array  # (3,) of unit length
    range_m: float  # NaN: not measured
    covariance: Array  # (3, 3) of [range, off the ray along both columns of ``basis``], metres and radians; NaN of a
    # range that was not measured
    sensor: Array = field(default_factory=lambda: np.zeros(3))  # (3,) camera in the body frame, metres
    log_range: LogRange = ANYWHERE  # prior of an unmeasured range, if its object is new
    feature: Array = field(default_factory=lambda: np.zeros(0))  # (F,) z_sem
    feature_covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))  # (F, F) of the dropout samples

    @cached_property
    def has_range(self) -> bool:
        """Whether its range was measured."""
        return bool(np.isfinite(self.range_m))

    @cached_property
    def origin(self) -> Array:
        """(3,) where in the body frame the ray begins."""
        return np.zeros(3) if self.has_range else self.sensor

    @cached_property
    def feature_variance(self) -> Array:
        """(F,) diagonal of the feature's covariance."""
        return np.array(self.feature_covariance.diagonal())

    @property
    def elevation_rad(self) -> float:
        """NaN: the elevation of the camera over an object follows from their positions."""
        return float("nan")

    @property
    def turn_variance(self) -> float:
        """[rad^2] of the ray in its most uncertain direction, 0 for a ray alone, which gives no position.

        It measures how nonlinear a position is that is rotated by this error.
        """
        return self.ray_variance if self.has_range else 0.0

    @cached_property
    def ray_variance(self) -> float:
        """[rad^2] of the ray in its most uncertain direction."""
        return float(np.linalg.eigvalsh(self.covariance[1:, 1:])[-1])

    @cached_property
    def direction(self) -> Any:
        """The ray as a GTSAM Unit3."""
        return gtsam.Unit3(self.ray)

    @cached_property
    def basis(self) -> Array:
        """(3, 2) axes of the plane across the ray, as GTSAM has them."""
        return across(self.ray)

    @cached_property
    def whiten(self) -> Array:
        """(3, 3) matrix that whitens residuals of range and ray; 0 for a range that was not measured."""
        if not self.has_range:
            whiten = np.zeros((3, 3))
            whiten[1:, 1:] = np.linalg.inv(np.linalg.cholesky(self.covariance[1:, 1:]))
            return whiten
        return np.asarray(np.linalg.inv(np.linalg.cholesky(self.covariance)))

    @cached_property
    def log_normaliser(self) -> float:
        """Log normaliser of the Gaussian density [nats], per metre and square radian; per square radian for a ray."""
        measured = np.diagonal(self.whiten)[0 if self.has_range else 1 :]
        return float(np.log(measured).sum() - 0.5 * len(measured) * LOG_2PI)

    @cached_property
    def is_round(self) -> bool:
        """Whether the ray's error is isotropic and independent of the range, so that its axes do not matter."""
        (a, b, c), (_, d, e), (_, _, f) = self.covariance.tolist()
        if not self.has_range:
            a, b, c = 0.0, 0.0, 0.0
        return bool(max(abs(d - f), abs(e)) <= ROUND * d and max(abs(b), abs(c)) <= ROUND * sqrt(a * d))

    @cached_property
    def noise(self) -> Any:
        """GTSAM's noise model, in its order: ray, range where it was measured."""
        order = [1, 2, 0] if self.has_range else [1, 2]
        return gtsam.noiseModel.Gaussian.Covariance(self.covariance[order][:, order])

    def widened(self, width: float) -> "SpatialDetection":
        """The detection with ``width`` times the error; cached, so that the result is one object per width."""
        if width not in self._widened:
            self._widened[width] = replace(self, covariance=width**2 * self.covariance)
        return self._widened[width]

    @cached_property
    def _widened(self) -> dict[float, "SpatialDetection"]:
        return {}


@dataclass(frozen=True, kw_only=True)
class SpatialDetections:
    """B detections as arrays; one row stands for any number."""

    ray: Array  # (B, 3)
    basis: Array  # (B, 3, 2)
    origin: Array  # (B, 3) in the body frame
    range_m: Array  # (B,) 0 where it was not measured
    has_range: Flags  # (B,)
    whiten: Array  # (B, 3, 3)
    log_normaliser: Array  # (B,)

    @classmethod
    def of(cls, detections: Sequence[SpatialDetection]) -> "SpatialDetections":
        """All detections of a keyframe."""
        count = len(detections)
        return cls(
            ray=np.array([item.ray for item in detections]).reshape(count, 3),
            basis=np.array([item.basis for item in detections]).reshape(count, 3, 2),
            origin=np.array([item.origin for item in detections]).reshape(count, 3),
            range_m=np.array([item.range_m if item.has_range else 0.0 for item in detections], dtype=np.float64),
            has_range=np.array([item.has_range for item in detections], dtype=bool),
            whiten=np.array([item.whiten for item in detections]).reshape(count, 3, 3),
            log_normaliser=np.array([item.log_normaliser for item in detections], dtype=np.float64),
        )

    def take(self, index: Selection) -> "SpatialDetections":
        """Rows of a selection."""
        return take(self, index)
