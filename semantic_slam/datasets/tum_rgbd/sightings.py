"""What a camera of a folder shows frame by frame: boxes with their places where depth tells them, and its pictures."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from semantic_slam.datasets.drives.drive import Message
from semantic_slam.datasets.drives.tables import found
from semantic_slam.datasets.image_folders.detections import (
    Detector,
    found_in_picture,
    with_named_classes,
    with_positions,
)
from semantic_slam.datasets.image_folders.image_folder import read_depth
from semantic_slam.datasets.image_folders.pictures import picture
from semantic_slam.datasets.space.levelling import OPTICAL
from semantic_slam.datasets.tum_rgbd.boxes import read_boxes
from semantic_slam.datasets.tum_rgbd.folder import DEPTH_PER_METRE, TumFolder
from semantic_slam.errors import InputError
from semantic_slam.geometry.pose import rotation_matrix
from semantic_slam.perception.frame import Detections

DETECTIONS = "detections.csv"
SYNCHRONOUS_NS = 20_000_000
"""Farther apart in time, colour and depth are not one picture."""

Found = tuple[list[Detections], list[tuple[str, ...]] | None]
"""(F,) frames at stamps that grow, and (F,) of (D,) true ids where they are known."""


def found_boxes(folder: TumFolder, detector: Detector | None) -> Found:
    """The boxes of a detector, or without one those of ``detections.csv``. Raises InputError."""
    if detector is None:
        return read_boxes(found(folder.path, DETECTIONS)).frames(folder.colour.stamps_ns)
    if not folder.colour.are_there:
        raise InputError(f"{folder.path}: no pictures for --detector; restore rgb.txt and rgb/, or leave it out")
    rows = zip(folder.colour.files, folder.colour.stamps_ns.tolist(), strict=True)
    told = [
        found_in_picture(detector, file, stamp_ns)
        for file, stamp_ns in tqdm(rows, total=len(folder.colour.files), desc="boxes", unit="image")
    ]
    return with_named_classes(told), None


def with_places(folder: TumFolder, told: Detections) -> Detections:
    """The boxes with positions in the body, where there is depth. Raises InputError."""
    depth_m = depth_at(folder, told.stamp_ns)
    if depth_m is None or not len(told):
        return told
    return with_positions(told, depth_m, folder.camera, rotation_matrix(OPTICAL[3:]))


def pictures_at(folder: TumFolder, stamps_ns: list[int]) -> Iterator[Message]:
    """Colour and depth at the stamps of frames, as far as the files are there. Raises InputError."""
    for stamp_ns in stamps_ns if folder.colour.are_there else ():
        colour: Path | None = folder.colour.nearest(stamp_ns, SYNCHRONOUS_NS)
        if colour is not None:
            yield from picture(colour, depth_at(folder, stamp_ns), stamp_ns)


def depth_at(folder: TumFolder, stamp_ns: int) -> NDArray[np.float32] | None:
    """(height, width) metres of the depth picture nearest in time; None where none is near. Raises InputError."""
    file = folder.depth.nearest(stamp_ns, SYNCHRONOUS_NS) if folder.depth.are_there else None
    return None if file is None else read_depth(file, folder.camera, DEPTH_PER_METRE)
