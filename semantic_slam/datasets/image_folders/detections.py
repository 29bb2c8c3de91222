"""What stands in the pictures of a folder: a detector's boxes with their places in the level body."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from semantic_slam.datasets.drives.tables import lines_of, numbers
from semantic_slam.datasets.frames import CAMERA_FRAME
from semantic_slam.datasets.image_folders.box_places import bearing_of_box, place_of_box
from semantic_slam.datasets.image_folders.image_folder import ImageFrame, read_colour
from semantic_slam.geometry.arrays import Array, Bytes
from semantic_slam.perception.frame import CameraModel, Detections

LABEL = "object"
"""Label of a folder's own boxes, which have none."""
BOX_COLUMNS = ("x", "y", "w", "h", "p")
LEAST_REPORTED = 0.05
"""Lower scores of a class are not reported: they tell no more than that it is none of these."""


class Detector(Protocol):
    """From a picture to boxes; see :class:`semantic_slam.perception.onnx.detector.OnnxDetector`."""

    def __call__(self, image: Bytes, *, stamp_ns: int, frame_id: str) -> Detections: ...


def own_boxes(frame: ImageFrame, stamp_ns: int) -> Detections:
    """The boxes that a folder has of a frame, from lines of x y w h p. Raises InputError."""
    remedy = f"lines of '{' '.join(BOX_COLUMNS)}' are expected"
    lines = lines_of(frame.boxes, remedy) if frame.boxes is not None else ()
    rows = np.array([numbers(line, BOX_COLUMNS, remedy) for line in lines]).reshape(-1, len(BOX_COLUMNS))
    return Detections(
        stamp_ns=stamp_ns,
        frame_id=CAMERA_FRAME,
        boxes=np.column_stack([rows[:, :2], rows[:, :2] + rows[:, 2:4]]),
        labels=(LABEL,) * len(rows),
        scores=rows[:, 4],
        track_ids=("",) * len(rows),
    )


def found_by(detector: Detector) -> Callable[[ImageFrame, int], Detections]:
    """A detector's answer for each frame, without scores of classes that say nothing."""

    def found(frame: ImageFrame, stamp_ns: int) -> Detections:
        return found_in_picture(detector, frame.colour, stamp_ns)

    return found


def found_in_picture(detector: Detector, colour: Path, stamp_ns: int) -> Detections:
    """A detector's answer for a file, without scores of classes that say nothing. Raises InputError."""
    told = detector(read_colour(colour), stamp_ns=stamp_ns, frame_id=CAMERA_FRAME)
    return replace(told, class_scores=np.where(told.class_scores >= LEAST_REPORTED, told.class_scores, np.nan))


def with_named_classes(found: list[Detections]) -> list[Detections]:
    """The detections with scores of those classes alone that any of them reports."""
    if not found:
        return []
    reported = np.any([np.isfinite(told.class_scores).any(axis=0) for told in found], axis=0)
    names = tuple(name for name, is_named in zip(found[0].class_names, reported, strict=True) if is_named)
    return [replace(told, class_names=names, class_scores=told.class_scores[:, reported]) for told in found]


def with_positions(
    told: Detections,
    depth_m: NDArray[np.float32],
    camera: CameraModel,
    R_body_camera: Array,
    depth_to_width: float = 0.0,
) -> Detections:
    """With positions in the body frame from depth; NaN where a box shows none.

    In space such a box needs no more: the camera's intrinsics make it a ray.
    """
    positions, covariances = np.full((len(told), 3), np.nan), np.full((len(told), 3, 3), np.nan)
    for row, box in enumerate(told.boxes):
        positions[row], covariances[row] = place_of_box(box, depth_m, camera, R_body_camera, depth_to_width)
    return replace(told, positions=positions, position_covariances=covariances)


def with_bearings(told: Detections, camera: CameraModel, R_body_camera: Array) -> Detections:
    """With bearings alone where a box has no position, for a robot in the plane."""
    bearings, elevations = np.full(len(told), np.nan), np.full(len(told), np.nan)
    covariances = np.full((len(told), 3, 3), np.nan)
    for row in np.flatnonzero(np.isnan(told.positions).any(axis=1)):
        bearings[row], elevations[row], sigma = bearing_of_box(told.boxes[row], camera, R_body_camera)
        covariances[row, [1, 2], [1, 2]] = sigma**2
    return replace(told, bearings_rad=bearings, elevations_rad=elevations, place_covariances=covariances)
