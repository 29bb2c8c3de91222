"""Colour and depth pictures of a hand-held camera in a folder, whatever its layout."""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array, Bytes
from semantic_slam.messages.picture_files import read_picture
from semantic_slam.perception.frame import CameraModel

INVALID = 65535
"""Besides 0, a depth reading that says nothing."""


@dataclass(frozen=True, kw_only=True)
class ImageFrame:
    """The files of one instant."""

    time_s: float
    colour: Path
    depth: Path
    boxes: Path | None = None  # what a detector found, where the folder has it
    T_world_camera: Array | None = None  # (4, 4) of the optical frame; None: not known

    def image(self) -> Bytes:
        """(height, width, 3) RGB picture. Raises InputError."""
        return read_colour(self.colour)


@dataclass(frozen=True, kw_only=True)
class ImageFolder:
    """F frames in the order of their times; either all know their poses, or none."""

    path: Path
    frames: tuple[ImageFrame, ...]
    camera: CameraModel
    depth_per_metre: float  # readings of a depth picture
    down: Array  # (3,) unit vector along gravity, in the world of the poses
    has_clock: bool  # times are the source's own, not made up of the numbers of the frames

    @property
    def poses(self) -> Array | None:
        """(F, 4, 4) T_world_camera; None where they are not known."""
        known = [frame.T_world_camera for frame in self.frames if frame.T_world_camera is not None]
        return np.array(known) if known else None

    def depth_m(self, frame: ImageFrame) -> NDArray[np.float32]:
        """(height, width) metres along the optical axis, NaN where invalid. Raises InputError."""
        return read_depth(frame.depth, self.camera, self.depth_per_metre)


def read_colour(path: Path) -> Bytes:
    """(height, width, 3) RGB picture of a file. Raises InputError."""
    return np.ascontiguousarray(read_picture(path, cv2.IMREAD_COLOR)[..., ::-1], dtype=np.uint8)


def read_depth(path: Path, camera: CameraModel, per_metre: float) -> NDArray[np.float32]:
    """(height, width) metres along the optical axis of a file, NaN where invalid. Raises InputError."""
    readings = read_picture(path, cv2.IMREAD_UNCHANGED)
    if readings.dtype != np.uint16 or readings.ndim != 2:
        raise InputError(f"{path}: not a depth picture of 16 bits; restore it from the data set")
    if readings.shape != (camera.height, camera.width):
        size = f"{camera.width} x {camera.height}"
        raise InputError(f"{path}: not of the colour picture's size, {size}; register depth to colour")
    metres = readings.astype(np.float32) / np.float32(per_metre)
    return np.where((readings == 0) | (readings == INVALID), np.float32(np.nan), metres)
