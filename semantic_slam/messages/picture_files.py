"""Reading of image files, with the size in the header checked before decoding."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from semantic_slam.errors import InputError
from semantic_slam.messages.image_size import claimed_size, is_known
from semantic_slam.messages.images import MOST_PIXELS

TOO_LARGE = "CV_IO_MAX_IMAGE_"
"""Part of OpenCV's error message for an image with more pixels, rows or columns than it allows."""


def read_picture(path: Path, mode: int) -> NDArray[Any]:
    """Read an image file with a ``cv2.imread`` mode. Raises InputError; too large images are not decoded."""
    picture = decode_picture(_content(path), mode, str(path))
    if picture is None:
        raise InputError(f"{path}: missing or not a picture; restore it from the data set")
    return picture


def decode_picture(data: bytes, mode: int, origin: str) -> NDArray[Any] | None:
    """Decode an image to an OpenCV array, or None where the bytes are no image.

    Raises InputError, naming ``origin``, for an image that claims more than MOST_PIXELS pixels. A PNG or JPEG is
    checked before OpenCV sees it; other formats only where cv2 was first imported after this package, which sets
    OpenCV's limit.
    """
    size = claimed_size(data)
    if size is not None and size[0] * size[1] > MOST_PIXELS:
        raise InputError(f"{origin}: claims {size[0]} x {size[1]} pixels; give a smaller picture")
    if not data or (size is None and is_known(data)):
        return None
    try:
        return cv2.imdecode(np.frombuffer(data, dtype=np.uint8), mode)
    except cv2.error as fault:
        if TOO_LARGE in str(fault):
            raise InputError(f"{origin}: claims more than {MOST_PIXELS} pixels; give a smaller picture") from None
        return None


def _content(path: Path) -> bytes:
    """Bytes of a file; empty where it cannot be read."""
    try:
        return path.read_bytes() if path.is_file() else b""
    except OSError:
        return b""
