"""Detections in space with classifier features, as arrays."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.rows import Selection, take
from semantic_slam.inference.models.spatial.detection import SpatialDetection, SpatialDetections


@dataclass(frozen=True, kw_only=True)
class ScoredDetections(SpatialDetections):
    """B detections with their features; one row stands for any number."""

    sensor: Array  # (B, 3) cameras in the body frame
    feature: Array  # (B, F)
    feature_covariance: Array  # (B, F, F)
    log_outlier: Array  # (B,) log density of the feature as an outlier, 0 where none is one

    @classmethod
    def of(cls, detections: Sequence[SpatialDetection]) -> "ScoredDetections":
        """All detections of a keyframe."""
        count, size = len(detections), detections[0].feature.size if detections else 0
        return cls(
            **vars(SpatialDetections.of(detections)),
            sensor=np.array([item.sensor for item in detections]).reshape(count, 3),
            feature=np.array([item.feature for item in detections]).reshape(count, size),
            feature_covariance=np.array([item.feature_covariance for item in detections]).reshape(count, size, size),
            log_outlier=np.zeros(count),
        )

    def take(self, index: Selection) -> "ScoredDetections":
        """Rows of a selection."""
        return take(self, index)
