"""Camera frame: image, depth, intrinsics and a detector's boxes at one instant."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array, Bytes, Index
from semantic_slam.geometry.optional_arrays import fill_left_out, left_out
from semantic_slam.geometry.rows import with_rows
from semantic_slam.geometry.transform import compose, inverse


@dataclass(frozen=True)
class CameraModel:
    """Pinhole intrinsics in pixels, for images of ``width`` x ``height``, with distortion as OpenCV has it."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()  # k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4 [tx ty]]]]
    frame_id: str = "camera_optical_frame"  # optical frame: z forward, x right, y down (REP-103)
    rectification: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)  # qx qy qz qw of R of rectified pictures

    def optical_pose(self, T_base_frame: Array) -> Array:
        """(7,) pose of the camera of the pictures, by the (7,) pose of the frame ``frame_id``.

        R takes coordinates of the raw camera to those of the rectified one (sensor_msgs/CameraInfo): p_rect = R p_raw.
        """
        if self.rectification == CameraModel.rectification:
            return T_base_frame
        return compose(T_base_frame, inverse(np.array([0.0, 0.0, 0.0, *self.rectification])))


@dataclass(frozen=True, kw_only=True)
class Detections:
    """Detections of one instant; D rows each, C classes, E components of an embedding.

    Float arrays from ``class_scores`` on may be left out and are then NaN (embeddings: zero components).
    """

    stamp_ns: int  # of the image
    frame_id: str  # the camera's optical frame; without boxes that of the positions
    boxes: Array  # (D, 4) x_min y_min x_max y_max, pixels; NaN: no box
    labels: tuple[str, ...]  # "" when the detector gives none
    scores: Array  # (D,) 0..1
    track_ids: tuple[str, ...]  # "" when unknown
    class_names: tuple[str, ...] = ()  # (C,) of class_scores
    class_scores: Array = field(default_factory=left_out)  # (D, C) 0..1, NaN where not reported
    embeddings: Array = field(default_factory=left_out)  # (D, E) appearance, in the detector's own units
    positions: Array = field(default_factory=left_out)  # (D, 3) x y z, metres, in the body frame beside boxes
    position_covariances: Array = field(default_factory=left_out)  # (D, 3, 3) of positions
    ranges_m: Array = field(default_factory=left_out)  # (D,) from the body's origin
    bearings_rad: Array = field(default_factory=left_out)  # (D,) in the body frame, counter-clockwise from x
    elevations_rad: Array = field(
        default_factory=left_out
    )  # (D,) downward angle of the line of sight in the body frame
    place_covariances: Array = field(default_factory=left_out)  # (D, 3, 3) of range, bearing, elevation

    def __post_init__(self) -> None:
        rows = len(self)
        shapes: dict[str, tuple[int, ...]] = {name: (rows,) for name in ("ranges_m", "bearings_rad", "elevations_rad")}
        shapes |= {name: (rows, 3, 3) for name in ("position_covariances", "place_covariances")}
        shapes |= {"positions": (rows, 3), "class_scores": (rows, len(self.class_names)), "embeddings": (rows, 0)}
        fill_left_out(self, shapes)

    def __len__(self) -> int:
        return len(self.labels)

    def take(self, rows: Index) -> "Detections":
        """The selected detections."""
        return with_rows(self, rows, whole=("stamp_ns", "frame_id", "class_names"))


@dataclass(frozen=True)
class Frame:
    """One image with its detections, ready for measurement."""

    stamp_ns: int
    image: Bytes  # (height, width, 3) RGB
    depth_m: NDArray[np.float32] | None  # (height, width) along the optical axis, NaN where invalid; None: no depth
    camera: CameraModel
    detections: Detections
    T_base_camera: Array | None = None  # (7,) pose of the camera's frame at this instant; None: fixed mounting
