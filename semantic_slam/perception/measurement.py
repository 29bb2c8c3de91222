"""The semantic measurements of one frame: what perception hands to inference."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array, Flags, Index


@dataclass(frozen=True)
class SemanticMeasurements:
    """D detections, T dropout passes, C classes, F feature components."""

    stamp_ns: int
    sequence: int  # 0, 1, 2, ... one per detection message
    frame_id: str  # the robot's body frame, base_link
    class_names: tuple[str, ...]  # (C,)
    detection_ids: NDArray[np.uint32]  # (D,)
    boxes: Array  # (D, 4) pixels
    labels: tuple[str, ...]  # (D,)
    scores: Array  # (D,)
    track_ids: tuple[str, ...]  # (D,) "" when unknown
    class_probability_samples: Array  # (D, T, C)
    features: Array  # (D, F) mean of the semantic feature over the passes
    feature_covariances: Array  # (D, F, F)
    predictive_entropy: Array  # (D,) nats
    mutual_information: Array  # (D,) nats
    ranges_m: Array  # (D,) NaN without depth
    bearings_rad: Array  # (D,) seen from the body's origin with depth, from sensor_position without
    geometric_covariances: Array  # (D, 2, 2) of [range, bearing]
    sensor_position: Array  # (3,) camera in the body frame, metres
    in_coverage: Flags  # (D,)
    dropped: int = 0  # inputs the classifier has not used so far
    free_range_scan: Array = field(
        default_factory=lambda: np.zeros((0, 2))
    )  # (B, 2) bearing [rad], range [m] of the farthest
    # surface that the depth image shows in each direction, from the body's origin; none without depth
    elevations_rad: Array = field(default_factory=lambda: np.zeros(0))  # (D,) how far the camera looks down on the
    # centre of the box, in the body frame; left out: level

    def __post_init__(self) -> None:
        if not len(self.elevations_rad):
            object.__setattr__(self, "elevations_rad", np.zeros(len(self)))

    def __len__(self) -> int:
        return len(self.detection_ids)

    def take(self, rows: Index) -> "SemanticMeasurements":
        """Some of the detections."""
        some: dict[str, Any] = {name: getattr(self, name)[rows] for name in OF_DETECTIONS}
        some |= {name: tuple(getattr(self, name)[row] for row in rows) for name in ("labels", "track_ids")}
        return replace(self, **some)


OF_DETECTIONS = (
    "detection_ids",
    "boxes",
    "scores",
    "class_probability_samples",
    "features",
    "feature_covariances",
    "predictive_entropy",
    "mutual_information",
    "ranges_m",
    "bearings_rad",
    "geometric_covariances",
    "in_coverage",
    "elevations_rad",
)
"""Arrays with a row per detection."""
