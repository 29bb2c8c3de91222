"""Pixels of sensor_msgs Image and CompressedImage: colour as RGB, depth in metres; and depth by a DisparityImage."""

import struct
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from semantic_slam.errors import MessageError
from semantic_slam.messages.disparity import ENCODING, UNIT_REMEDY, depth_of_disparity, is_disparity
from semantic_slam.messages.image_size import claimed_size

COLOUR_CHANNELS = {"rgb8": 3, "bgr8": 3, "8UC3": 3, "rgba8": 4, "bgra8": 4, "mono8": 1, "8UC1": 1}
"""Raw colour encodings and their channels; 8UC3 is taken for BGR, as OpenCV stores it."""
TO_RGB = {
    "bgr8": cv2.COLOR_BGR2RGB,
    "8UC3": cv2.COLOR_BGR2RGB,
    "rgba8": cv2.COLOR_RGBA2RGB,
    "bgra8": cv2.COLOR_BGRA2RGB,
    "mono8": cv2.COLOR_GRAY2RGB,
    "8UC1": cv2.COLOR_GRAY2RGB,
}
DEPTH_TYPES = {"16UC1": "u2", "mono16": "u2", "32FC1": "f4"}
"""Raw depth encodings: millimetres as 16-bit integers, metres as 32-bit floats."""
NUMBER_TYPES = {"8UC1": "u1", "mono8": "u1", "16UC1": "u2", "mono16": "u2", "32SC1": "i4"}
"""Encodings of segmentation images (integer segment ids)."""
METRES_PER_UNIT = 0.001
NEAREST_MEDIAN_M, FARTHEST_MEDIAN_M = 0.02, 200.0
"""Plausible range of a depth image's median [m]."""
UNIT_STRIDE = 8
"""Pixel stride of the samples used to check the depth unit."""
MOST_PIXELS = 100_000_000
"""Largest number of pixels of an image; larger ones are refused before decoding."""
COMPRESSED_DEPTH_HEADER = struct.Struct("<iff")
"""Header of image_transport's compressedDepth before the PNG: format and two inverse-depth parameters."""


def decode_image(message: Any, topic: str) -> NDArray[np.uint8]:
    """(height, width, 3) RGB pixels; raises MessageError that names the topic and what is accepted."""
    if hasattr(message, "format"):
        pixels = _imdecode(message.data, cv2.IMREAD_COLOR, topic)
        if pixels is None:
            raise MessageError(f"{topic}: an image of format '{message.format}' does not decode; send jpeg or png")
        return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2RGB), dtype=np.uint8)
    channels = _known(message.encoding, COLOUR_CHANNELS, topic)
    pixels = _rows(message, np.dtype(np.uint8), channels, topic)
    conversion = TO_RGB.get(message.encoding)
    return np.asarray(pixels if conversion is None else cv2.cvtColor(pixels, conversion), dtype=np.uint8)


def decode_numbers(message: Any, topic: str) -> NDArray[Any]:
    """(height, width) whole numbers of a raw image; raises MessageError that names the topic and what is accepted."""
    kind = np.dtype(_known(message.encoding, NUMBER_TYPES, topic))
    return _rows(message, kind.newbyteorder(">" if message.is_bigendian else "<"), 1, topic)


def size_of(message: Any) -> tuple[int, int] | None:
    """(width, height) claimed by an image of any kind; None where it cannot be read from a compressed one."""
    if is_disparity(message):
        return size_of(message.image)
    if not hasattr(message, "format"):
        return int(message.width), int(message.height)
    data = np.asarray(message.data, dtype=np.uint8).tobytes()
    return claimed_size(data[_header_size(message) :])


def decode_depth(message: Any, topic: str) -> NDArray[np.float32]:
    """(height, width) metres along the optical axis, NaN where invalid; raises MessageError that names the topic.

    ``message`` is an Image, a CompressedImage or a DisparityImage.
    """
    if is_disparity(message):
        _known(message.image.encoding, {ENCODING: ""}, topic)
        return _metres(depth_of_disparity(message, decode_depth(message.image, topic), topic))
    if hasattr(message, "format"):
        return _compressed_depth(message, topic)
    kind = np.dtype(_known(message.encoding, DEPTH_TYPES, topic))
    values = _rows(message, kind.newbyteorder(">" if message.is_bigendian else "<"), 1, topic)
    return _metres(values.astype(np.float32) * (METRES_PER_UNIT if kind.kind == "u" else 1.0))


def _compressed_depth(message: Any, topic: str) -> NDArray[np.float32]:
    data = np.asarray(message.data)
    has_header = _header_size(message) > 0
    values = _imdecode(data[_header_size(message) :], cv2.IMREAD_UNCHANGED, topic)
    if values is None or values.dtype != np.uint16 or values.ndim != 2:
        raise MessageError(
            f"{topic}: a depth image of format '{message.format}' does not decode; send a 16UC1 png in millimetres"
        )
    if not (has_header and message.format.startswith("32FC1")):
        return _metres(values.astype(np.float32) * METRES_PER_UNIT)
    _, scale, offset = COMPRESSED_DEPTH_HEADER.unpack(data[: COMPRESSED_DEPTH_HEADER.size].tobytes())
    with np.errstate(divide="ignore", invalid="ignore"):
        return _metres(np.where(values > 0, scale / (values.astype(np.float32) - offset), np.nan))


def _header_size(message: Any) -> int:
    """Number of header bytes before the compressed image."""
    return COMPRESSED_DEPTH_HEADER.size if "compressedDepth" in message.format else 0


def check_unit(depth_m: NDArray[np.float32], message: Any, topic: str) -> None:
    """Raise MessageError where (height, width) depths decoded of a message are implausible in metres.

    So are floats in millimetres, integers in metres, and disparities with a baseline in millimetres.
    """
    sample = depth_m[::UNIT_STRIDE, ::UNIT_STRIDE]
    known = sample[np.isfinite(sample)]
    if known.size and not NEAREST_MEDIAN_M <= float(np.median(known)) <= FARTHEST_MEDIAN_M:
        remedy = UNIT_REMEDY if is_disparity(message) else "send 32FC1 in metres or 16UC1 in millimetres"
        raise MessageError(
            f"{topic}: half of it lies beyond {FARTHEST_MEDIAN_M:g} m or before {NEAREST_MEDIAN_M:g} m, so"
            f" bearings alone; {remedy}"
        )


def _metres(depth: NDArray[Any]) -> NDArray[np.float32]:
    return np.where(np.isfinite(depth) & (depth > 0.0), depth, np.nan).astype(np.float32)


def _imdecode(data: Any, flags: int, topic: str) -> NDArray[Any] | None:
    """OpenCV array, or None where the bytes are no image. Raises MessageError for more than MOST_PIXELS pixels."""
    buffer = np.asarray(data, dtype=np.uint8)
    size = claimed_size(buffer.tobytes())
    if size is None:
        return None
    if size[0] * size[1] > MOST_PIXELS:
        raise MessageError(f"{topic}: an image that claims more than {MOST_PIXELS} pixels; send a smaller one")
    try:
        return cv2.imdecode(buffer, flags)
    except cv2.error:
        return None


def _known(encoding: str, accepted: dict[str, Any], topic: str) -> Any:
    if encoding not in accepted:
        raise MessageError(f"{topic}: encoding '{encoding}' is not read; send one of {', '.join(accepted)}")
    return accepted[encoding]


def _rows(message: Any, kind: np.dtype[Any], channels: int, topic: str) -> NDArray[Any]:
    """(height, width[, channels]) pixels of a raw image, the padding of its rows removed."""
    height, width, data = message.height, message.width, np.asarray(message.data)
    used = width * channels * kind.itemsize
    if not used or message.step < used or len(data) != height * message.step or not height:
        raise MessageError(
            f"{topic}: {len(data)} bytes are no {width} x {height} image of {message.encoding} with rows of"
            f" {message.step} bytes; correct its width, height and step"
        )
    pixels = np.ascontiguousarray(data.reshape(height, message.step)[:, :used]).view(kind)
    return pixels if channels == 1 else pixels.reshape(height, width, channels)
