"""Detections as points of the body frame, for objects that move."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.inference.models.planar.polar import from_polar


@dataclass(frozen=True, kw_only=True)
class PlacedDetections:
    """D detections as points in the body frame; d constant sensor errors."""

    has_range: Flags  # (D,) a bearing alone is not used for moving objects
    points: Array  # (D, 2) metres, as measured
    covariances: Array  # (D, 2, 2)
    by_error: Array  # (D, 2, 2) Jacobian by whitened range and bearing errors
    by_sensor: Array  # (D, 2, d) Jacobian by the constant sensor errors, in units of their standard deviations
    log_area: Array  # (D,) from a density per square metre to one per metre and radian

    @classmethod
    def of(cls, detections: Sequence[Any], sigmas: Array) -> Self:
        """With the covariances that a hypothesis assumes; ``sigmas`` (d,) of the constant sensor errors."""
        count = len(detections)
        has_range = np.array([item.has_range for item in detections], dtype=bool)
        reach = np.array([item.range_m for item in detections])
        reach = np.where(has_range, reach, 1.0)
        points, polar = from_polar(reach, np.array([item.bearing_rad for item in detections]))
        spread = np.array([item.covariance for item in detections]).reshape(count, 2, 2)
        spread = np.where(has_range[:, None, None], spread, np.eye(2))
        by_error = polar @ np.linalg.cholesky(spread)
        return cls(
            has_range=has_range,
            points=points,
            covariances=by_error @ np.swapaxes(by_error, -1, -2),
            by_error=by_error,
            by_sensor=polar[..., : len(sigmas)] * sigmas,
            log_area=np.log(reach),
        )

    def without_sensor_errors(self, numbers: Index, sensors: Array) -> Array:
        """(N, 2) points of the detections ``numbers`` (N,), corrected by expected sensor errors (N, d)."""
        points = self.points[numbers]
        if not sensors.shape[1]:
            return points
        return np.asarray(points - (self.by_sensor[numbers] @ sensors[..., None])[..., 0])
