"""Colour and depth images of any transport as the two kinds of input bags: compressed colour, depth png in mm."""

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from semantic_slam.messages.images import DEPTH_TYPES, MOST_PIXELS, check_unit, decode_depth, decode_image, size_of
from semantic_slam.messages.typestore import message_class

JPEG_QUALITY = 95
DEPTH_FORMAT = "16UC1; png compressed"


def is_depth(message: Any) -> bool:
    """Whether an Image or CompressedImage holds depth: 16 bit or float, one channel."""
    if hasattr(message, "encoding"):
        return message.encoding in DEPTH_TYPES
    if any(word in message.format for word in ("compressedDepth", *DEPTH_TYPES)):
        return True
    size = size_of(message)
    if size is None or size[0] * size[1] > MOST_PIXELS:
        return False
    image = cv2.imdecode(np.asarray(message.data), cv2.IMREAD_UNCHANGED)
    return image is not None and image.dtype == np.uint16 and image.ndim == 2


def compress_colour(message: Any, topic: str) -> Any:
    """sensor_msgs/CompressedImage (JPEG) of a raw colour image; raises InputError."""
    image = cv2.cvtColor(decode_image(message, topic), cv2.COLOR_RGB2BGR)
    return _compressed(message.header, "jpeg", cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]))


def compress_depth(message: Any, topic: str) -> Any:
    """sensor_msgs/CompressedImage (16-bit png, mm, 0 invalid) of any depth image; raises InputError."""
    depth_m = decode_depth(message, topic)
    check_unit(depth_m, message, topic)
    return encoded_depth(depth_m, message.header)


def encoded_depth(depth_m: NDArray[np.float32], header: Any) -> Any:
    """sensor_msgs/CompressedImage (16-bit png, mm, 0 invalid) of (height, width) metres."""
    fast = [cv2.IMWRITE_PNG_COMPRESSION, 1]
    return _compressed(header, DEPTH_FORMAT, cv2.imencode(".png", to_millimetres(depth_m), fast))


def to_millimetres(depth_m: NDArray[np.float32]) -> NDArray[np.uint16]:
    """Metres as 16-bit millimetres; what is not finite, not positive or beyond 65.535 m becomes 0, invalid."""
    millimetres = np.rint(np.nan_to_num(depth_m.astype(np.float64) * 1000.0, nan=0.0, posinf=0.0, neginf=0.0))
    return np.where((millimetres > 0) & (millimetres <= 65535), millimetres, 0).astype(np.uint16)


def _compressed(header: Any, text: str, encoded: tuple[bool, NDArray[np.uint8]]) -> Any:
    return message_class("sensor_msgs/msg/CompressedImage")(header=header, format=text, data=encoded[1])
