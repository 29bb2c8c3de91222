"""What detections tell a learned likelihood, as arrays."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semantic_slam.inference.planar_detection import PlanarDetection

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SeenFeatures:
    """Of B detections; one row stands for any number."""

    feature: Array  # (B, F)
    variance: Array  # (B, F) of the feature's components, over the dropout passes
    sensor: Array  # (B, 2) camera in the body frame, metres
    elevation_rad: Array  # (B,) of the camera over the object

    @classmethod
    def of(cls, detections: Sequence[PlanarDetection]) -> "SeenFeatures":
        """All detections of a keyframe."""
        return cls(
            np.array([item.feature for item in detections]),
            np.array([item.feature_variance for item in detections]),
            np.array([item.sensor for item in detections]),
            np.array([item.elevation_rad for item in detections]),
        )

    def take(self, index: Any) -> "SeenFeatures":
        """Rows of a selection."""
        return SeenFeatures(self.feature[index], self.variance[index], self.sensor[index], self.elevation_rad[index])
