"""Photographs of a cabinet and of what stands in a kitchen, each from a direction that the given poses tell."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from semantic_slam.datasets.image_folders.detections import with_positions
from semantic_slam.datasets.image_folders.detector_arguments import given_detector
from semantic_slam.datasets.image_folders.image_folder import ImageFolder
from semantic_slam.datasets.image_folders.images_import import found_in
from semantic_slam.datasets.image_folders.journey import Journey, journey_by_truth
from semantic_slam.datasets.image_folders.layouts import read_image_folder
from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array, Bytes
from semantic_slam.perception.crops import square_crop
from semantic_slam.perception.frame import Detections
from semantic_slam_lab.studies.real_kitchen.reference import ONE_OBJECT_M, agreed_places

CABINET = "cabinet"
CABINET_WIDTH = 0.5
"""The cabinet is as deep as wide and seen from all around: its middle lies half a width behind what is seen."""
KITCHEN = {"chair": 3, "cup": 2, "tvmonitor": 1, "diningtable": 1}
"""Objects of the kitchen that NanoDet names so."""
EVERY = 3
"""Frames of the kitchen that are looked at: one of so many."""


@dataclass(frozen=True)
class Photograph:
    """One crop of one object."""

    class_name: str
    object_name: str
    crop: Bytes  # (size, size, 3)
    relative_m: Array  # (2,) the camera against the object, in the level world
    frame: int

    @property
    def azimuth_rad(self) -> float:
        """Direction from the object to the camera."""
        return float(np.arctan2(self.relative_m[1], self.relative_m[0]))


def photographs(data: Path, size: int, *, quick: bool) -> list[Photograph]:
    """All views of both folders of ``data``, or ``quick``'s few, in their order. Raises InputError."""
    cabinet = read_image_folder(data / "cabinet_58")
    cabinet = replace(cabinet, frames=cabinet.frames[:: 2 if quick else 1])
    boxes = found_in(cabinet, None)
    boxes = [replace(told, labels=(CABINET,) * len(told)) for told in boxes]
    kitchen = read_image_folder(data / "redkitchen")
    kitchen = replace(kitchen, frames=kitchen.frames[:: 2 * EVERY if quick else EVERY])
    detector = given_detector(data / "weights" / "nanodet_m.onnx", data / "weights" / "coco.names")
    found = found_in(kitchen, detector)
    return [
        *views_of(cabinet, boxes, {CABINET: 1}, size, CABINET_WIDTH),
        *views_of(kitchen, found, KITCHEN, size, 0.0),
    ]


def views_of(
    folder: ImageFolder, found: Sequence[Detections], counts: Mapping[str, int], size: int, depth_to_width: float
) -> list[Photograph]:
    """Crops of as many objects of each label as there are, where most boxes agree. Raises InputError."""
    journey = journey_by_truth(folder, 0.0, 0)
    assert journey.truth is not None
    places = _places(folder, found, journey, depth_to_width)
    made: list[Photograph] = []
    for label, count in counts.items():
        own = [(frame, row) for frame, told in enumerate(found) for row in _rows(told, label, places[frame])]
        where = np.array([places[frame][row] for frame, row in own]).reshape(-1, 2)
        for number, (position, _) in enumerate(agreed_places(where, count)):
            for frame, row in own:
                if np.linalg.norm(places[frame][row] - position) <= ONE_OBJECT_M:
                    crop = square_crop(folder.frames[frame].image(), found[frame].boxes[row], size)
                    relative = journey.truth.poses[frame, :2] - position
                    made.append(Photograph(label, f"{label} {number + 1}", crop, relative, frame))
    return made


def _rows(told: Detections, label: str, places: Array) -> list[int]:
    return [row for row, own in enumerate(told.labels) if own == label and np.isfinite(places[row]).all()]


def _places(folder: ImageFolder, found: Sequence[Detections], journey: Journey, depth_to_width: float) -> list[Array]:
    """(D, 2) places in the level world of each frame's boxes."""
    assert journey.truth is not None
    made = []
    rows = zip(folder.frames, found, journey.R_body_camera, journey.truth.poses, strict=True)
    for frame, told, rotation, pose in rows:
        positions = with_positions(told, folder.depth_m(frame), folder.camera, rotation, depth_to_width).positions
        level = np.column_stack([positions[:, :2], np.zeros(len(positions))])
        made.append(np.asarray(se2.compose(pose, level)[:, :2]))
    return made
