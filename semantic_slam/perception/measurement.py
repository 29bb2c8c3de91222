"""Semantic measurements of one frame: the interface from perception to inference."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.geometry.optional_arrays import fill_left_out, left_out
from semantic_slam.geometry.rows import with_rows

OF_THE_FRAME = frozenset(
    {
        "stamp_ns",
        "sequence",
        "frame_id",
        "class_names",
        "sensor_position",
        "sensor_orientation",
        "dropped",
        "free_range_scan",
        "image_edges_rad",
        "free_ranges_m",
    }
)
"""Fields of :class:`SemanticMeasurements` that describe the whole frame, without a row per detection."""


@dataclass(frozen=True, kw_only=True)
class SemanticMeasurements:
    """Measurements of D detections; T dropout passes, C classes, F feature and E embedding components."""

    stamp_ns: int
    sequence: int  # 0, 1, 2, ... one per detection message
    frame_id: str  # the robot's body frame, base_link
    class_names: tuple[str, ...]  # (C,) of class_probability_samples and of class_scores
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
    bearings_rad: Array  # (D,) seen from the body's origin with depth, from sensor_position without: of the ray from
    # there along the body's axes, with elevations_rad
    geometric_covariances: Array  # (D, 2, 2) of [range, bearing]
    sensor_position: Array  # (3,) camera in the body frame, metres
    in_coverage: Flags  # (D,)
    dropped: int = 0  # number of inputs dropped by the classifier so far
    free_range_scan: Array = field(default_factory=lambda: np.zeros((0, 2)))  # (B, 2) bearing [rad], range [m] of the
    # farthest surface that the depth image shows in each direction, from the body's origin; none without depth
    elevations_rad: Array = field(default_factory=left_out)  # (D,) how far the camera looks down on the
    # centre of the box, in the body frame; left out: level
    place_covariances: Array = field(
        default_factory=left_out
    )  # (D, 3, 3) of [range, bearing, elevation]; left out: NaN
    points: Array = field(default_factory=left_out)  # (D, 3) in the body frame, metres, of which ranges, bearings and
    # elevations are what a robot in the plane uses; left out: NaN
    point_covariances: Array = field(default_factory=left_out)  # (D, 3, 3) along the axes of the body; left out: NaN
    sensor_orientation: Array = field(default_factory=left_out)  # (4,) quaternion of the optical frame in the body
    # frame, z ahead; left out: NaN, along the body's x
    class_scores: Array = field(default_factory=left_out)  # (D, C) the detector's score of every class; left out: NaN
    embeddings: Array = field(
        default_factory=left_out
    )  # (D, E) the detector's appearance vector; left out: without components
    angular_sizes_rad: Array = field(default_factory=left_out)  # (D, 2) width and height of the box as seen from the
    # camera; NaN where the image's border cuts them; left out: NaN

    image_edges_rad: Array = field(default_factory=left_out)  # (2, 2) [left, right] and [top, bottom] edge of the image
    # off the optical axis; left out: NaN, not known
    free_ranges_m: Array = field(default_factory=left_out)  # (R, C) of the farthest surface of the depth image in each
    # direction of a grid between these edges; left out: no cells

    def __post_init__(self) -> None:
        rows = len(self)
        if not len(self.elevations_rad):
            object.__setattr__(self, "elevations_rad", np.zeros(rows))
        shapes = {"class_scores": (rows, len(self.class_names)), "embeddings": (rows, 0)}
        spatial = {"points": (rows, 3), "place_covariances": (rows, 3, 3), "point_covariances": (rows, 3, 3)}
        spatial |= {"sensor_orientation": (4,), "angular_sizes_rad": (rows, 2)}
        spatial |= {"image_edges_rad": (2, 2), "free_ranges_m": (0, 0)}
        fill_left_out(self, shapes | spatial)

    def __len__(self) -> int:
        return len(self.detection_ids)

    @property
    def places(self) -> Array:
        """(D, 3) places in the body frame [m]: the points, else from range, bearing and elevation; NaN: not known."""
        level = self.ranges_m * np.cos(self.elevations_rad)
        sideways = np.cos(self.bearings_rad), np.sin(self.bearings_rad)
        polar = np.stack(
            [level * sideways[0], level * sideways[1], self.ranges_m * np.sin(self.elevations_rad)], axis=1
        )
        return np.where(np.isfinite(self.points), self.points, polar)

    def take(self, rows: Index) -> "SemanticMeasurements":
        """Measurements of the selected detections."""
        return with_rows(self, rows, whole=OF_THE_FRAME)
