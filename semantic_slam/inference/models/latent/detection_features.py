"""Inputs of the learned likelihood from detections, as arrays."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.rows import Selection, take
from semantic_slam.inference.models.planar.detection import PlanarDetection
from semantic_slam.inference.models.spatial.detection import SpatialDetection


@dataclass(frozen=True, kw_only=True)
class DetectionFeatures:
    """Semantic features of B detections as arrays; one row stands for any number."""

    feature: Array  # (B, F)
    variance: Array  # (B, F) of the feature's components, over the dropout passes
    sensor: Array  # (B, 2), or (B, 3) in space, camera in the body frame, metres
    elevation_rad: Array  # (B,) of the camera over the object, as measured with the box; NaN in space

    @classmethod
    def of(cls, detections: Sequence[PlanarDetection | SpatialDetection]) -> "DetectionFeatures":
        """All detections of a keyframe."""
        return cls(
            feature=np.array([item.feature for item in detections]),
            variance=np.array([item.feature_variance for item in detections]),
            sensor=np.array([item.sensor for item in detections]),
            elevation_rad=np.array([item.elevation_rad for item in detections]),
        )

    def take(self, index: Selection) -> "DetectionFeatures":
        """Rows of a selection."""
        return take(self, index)
