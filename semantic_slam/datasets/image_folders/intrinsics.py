"""Intrinsics of a folder of pictures: ``camera.txt``, or a matrix in a file of the data set's own."""

from pathlib import Path

import cv2

from semantic_slam.datasets.drives.tables import table
from semantic_slam.datasets.frames import CAMERA_FRAME
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array
from semantic_slam.messages.picture_files import read_picture
from semantic_slam.perception.frame import CameraModel

FILE = "camera.txt"
COLUMNS = ("fx", "fy", "cx", "cy", "width", "height")
REMEDY = f"one line '{' '.join(COLUMNS)}' in pixels is expected"


def camera_of(folder: Path, picture: Path, otherwise: tuple[float, float, float, float] | None) -> CameraModel:
    """The camera that ``camera.txt`` states, else ``otherwise`` (fx fy cx cy) with a picture's size.

    Raises InputError where neither is known, or where the picture has another size.
    """
    height, width = picture_size(picture)
    stated = folder / FILE
    if not stated.is_file():
        if otherwise is None:
            raise InputError(f"{stated}: missing, and nothing else tells the camera; {REMEDY}")
        return _camera(width, height, *otherwise)
    camera = stated_camera(folder)
    if (camera.width, camera.height) != (width, height):
        raise InputError(
            f"{stated}: {camera.width} x {camera.height}, but {picture.name} is {width} x {height}; {REMEDY}"
        )
    return camera


def stated_camera(folder: Path) -> CameraModel:
    """The camera that ``camera.txt`` states. Raises InputError."""
    stated = folder / FILE
    if not stated.is_file():
        raise InputError(f"{stated}: not there, and nothing else tells the camera; {REMEDY}")
    fx, fy, cx, cy, width, height = table(stated, COLUMNS, REMEDY, time=False)[0].tolist()
    if not (width >= 1.0 and height >= 1.0):
        raise InputError(f"{stated}: a picture of {width:g} x {height:g}; {REMEDY}")
    return _camera(int(width), int(height), fx, fy, cx, cy)


def matrix_intrinsics(matrix: Array) -> tuple[float, float, float, float]:
    """Focal lengths fx fy and principal point cx cy of a (3, 3) camera matrix."""
    return float(matrix[0, 0]), float(matrix[1, 1]), float(matrix[0, 2]), float(matrix[1, 2])


def picture_size(path: Path) -> tuple[int, int]:
    """Height and width of a picture file; raises InputError."""
    height, width = read_picture(path, cv2.IMREAD_COLOR).shape[:2]
    return int(height), int(width)


def _camera(width: int, height: int, fx: float, fy: float, cx: float, cy: float) -> CameraModel:
    if fx <= 0.0 or fy <= 0.0:
        raise InputError(f"focal lengths {fx:g} and {fy:g} are not above zero; {REMEDY}")
    return CameraModel(width, height, fx, fy, cx, cy, frame_id=CAMERA_FRAME)
