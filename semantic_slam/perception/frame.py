"""What a camera delivers at one instant: image, depth, intrinsics and a detector's boxes."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array, Bytes


@dataclass(frozen=True)
class CameraModel:
    """Pinhole intrinsics in pixels, for images of ``width`` x ``height``, with plumb-bob distortion."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()  # k1 k2 p1 p2 [k3]
    frame_id: str = "camera_optical_frame"  # optical frame: z forward, x right, y down (REP-103)


@dataclass(frozen=True)
class Detections:
    """A detector's boxes in one image; D rows each."""

    stamp_ns: int  # of the image
    frame_id: str  # the camera's optical frame
    boxes: Array  # (D, 4) x_min y_min x_max y_max, pixels
    labels: tuple[str, ...]  # "" when the detector gives none
    scores: Array  # (D,) 0..1
    track_ids: tuple[str, ...]  # "" when unknown

    def __len__(self) -> int:
        return len(self.labels)


@dataclass(frozen=True)
class Frame:
    """One image with its detections, ready to be measured."""

    stamp_ns: int
    image: Bytes  # (height, width, 3) RGB
    depth_m: NDArray[np.float32] | None  # (height, width) along the optical axis, NaN where invalid; None: no depth
    camera: CameraModel
    detections: Detections
