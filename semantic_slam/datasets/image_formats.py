"""Colour and depth images of any transport as the two kinds of input bags: compressed colour, depth png in mm."""

import struct
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from semantic_slam.errors import InputError
from semantic_slam.messages.typestore import message_class

JPEG_QUALITY = 95
DEPTH_FORMAT = "16UC1; png compressed"
DEPTH_ENCODINGS = ("16UC1", "mono16", "32FC1")
TO_BGR: dict[str, int | None] = {
    "bgr8": None,
    "8UC3": None,
    "mono8": None,
    "8UC1": None,
    "rgb8": cv2.COLOR_RGB2BGR,
    "rgba8": cv2.COLOR_RGBA2BGR,
    "bgra8": cv2.COLOR_BGRA2BGR,
    "8UC4": cv2.COLOR_BGRA2BGR,
    "bayer_rggb8": cv2.COLOR_BayerBG2BGR,  # OpenCV names a pattern by its second row, ROS by its first
    "bayer_bggr8": cv2.COLOR_BayerRG2BGR,
    "bayer_gbrg8": cv2.COLOR_BayerGR2BGR,
    "bayer_grbg8": cv2.COLOR_BayerGB2BGR,
    "yuv422": cv2.COLOR_YUV2BGR_UYVY,
    "uyvy": cv2.COLOR_YUV2BGR_UYVY,
    "yuv422_yuy2": cv2.COLOR_YUV2BGR_YUYV,
    "yuyv": cv2.COLOR_YUV2BGR_YUYV,
}
"""Raw encoding -> OpenCV's conversion, None where the bytes already are BGR or grey."""
CHANNELS = {
    "8UC3": 3,
    "bgr8": 3,
    "rgb8": 3,
    "8UC4": 4,
    "rgba8": 4,
    "bgra8": 4,
    "yuv422": 2,
    "uyvy": 2,
    "yuv422_yuy2": 2,
    "yuyv": 2,
}
COMPRESSED_DEPTH_HEADER = struct.Struct("<iff")
"""What image_transport's compressedDepth puts before the png: format, and the two numbers of its inverse depth."""


class UndecodableImageError(InputError):
    """One image that does not decode; the others may."""


def is_depth(message: Any) -> bool:
    """Whether an Image or CompressedImage holds depth: 16 bit or float, one channel."""
    if hasattr(message, "encoding"):
        return message.encoding in DEPTH_ENCODINGS
    if any(word in message.format for word in ("compressedDepth", *DEPTH_ENCODINGS)):
        return True
    image = cv2.imdecode(np.asarray(message.data), cv2.IMREAD_UNCHANGED) if len(message.data) else None
    return image is not None and image.dtype == np.uint16 and image.ndim == 2


def compress_colour(message: Any) -> Any:
    """sensor_msgs/CompressedImage (JPEG) of a raw colour image; raises UndecodableImageError."""
    if message.encoding not in TO_BGR:
        raise UndecodableImageError(f"encoding {message.encoding!r} is no colour image; use {', '.join(TO_BGR)}")
    pixels = _rows(message, np.dtype(np.uint8), CHANNELS.get(message.encoding, 1))
    conversion = TO_BGR[message.encoding]
    image = pixels if conversion is None else cv2.cvtColor(pixels, conversion)
    return _compressed(message.header, "jpeg", cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]))


def compress_depth(message: Any) -> Any:
    """sensor_msgs/CompressedImage (16-bit png, mm, 0 invalid) of any depth image; raises UndecodableImageError."""
    millimetres = _depth_from_raw(message) if hasattr(message, "encoding") else _depth_from_compressed(message)
    fast = [cv2.IMWRITE_PNG_COMPRESSION, 1]
    return _compressed(message.header, DEPTH_FORMAT, cv2.imencode(".png", millimetres, fast))


def to_millimetres(depth_m: NDArray[np.float32]) -> NDArray[np.uint16]:
    """Metres as 16-bit millimetres; what is not finite, not positive or beyond 65.535 m becomes 0, invalid."""
    millimetres = np.rint(np.nan_to_num(depth_m.astype(np.float64) * 1000.0, nan=0.0, posinf=0.0, neginf=0.0))
    return np.where((millimetres > 0) & (millimetres <= 65535), millimetres, 0).astype(np.uint16)


def _depth_from_raw(message: Any) -> NDArray[np.uint16]:
    if message.encoding not in DEPTH_ENCODINGS:
        raise UndecodableImageError(f"encoding {message.encoding!r} is no depth; use {', '.join(DEPTH_ENCODINGS)}")
    if message.encoding == "32FC1":
        return to_millimetres(_rows(message, np.dtype(np.float32), 1))
    return _rows(message, np.dtype(np.uint16), 1)


def _depth_from_compressed(message: Any) -> NDArray[np.uint16]:
    """A 16-bit png, or image_transport's compressedDepth: a header, and a png of millimetres or of inverse depth."""
    data = np.asarray(message.data)
    with_header = "compressedDepth" in message.format
    if with_header and "rvl" in message.format.lower():
        raise UndecodableImageError(f"depth format {message.format!r} is not read; record depth raw or as png")
    png = data[COMPRESSED_DEPTH_HEADER.size :] if with_header else data
    image = cv2.imdecode(png, cv2.IMREAD_UNCHANGED) if len(png) else None
    if image is None or image.dtype != np.uint16 or image.ndim != 2:
        raise UndecodableImageError(f"depth format {message.format!r} holds no 16-bit png; record depth raw")
    if not (with_header and "32FC1" in message.format):
        return np.asarray(image, dtype=np.uint16)
    _, scale, offset = COMPRESSED_DEPTH_HEADER.unpack(data[: COMPRESSED_DEPTH_HEADER.size].tobytes())
    with np.errstate(divide="ignore", invalid="ignore"):
        depth_m = np.where(image > 0, scale / (image.astype(np.float64) - offset), 0.0)
    return to_millimetres(depth_m.astype(np.float32))


def _rows(message: Any, dtype: np.dtype[Any], channels: int) -> NDArray[Any]:
    """(height, width) or (height, width, channels) pixels of a raw image, its rows' padding removed."""
    width = message.width * channels * dtype.itemsize
    data = np.asarray(message.data)
    if message.step < width or message.height * message.step != len(data) or not len(data):
        raise UndecodableImageError(
            f"raw image of {message.width} x {message.height} {message.encoding} has {len(data)} bytes; record it again"
        )
    rows = np.ascontiguousarray(data.reshape(message.height, message.step)[:, :width])
    pixels = rows.view(dtype.newbyteorder(">" if message.is_bigendian else "<")).astype(dtype, copy=False)
    return pixels if channels == 1 else pixels.reshape(message.height, message.width, channels)


def _compressed(header: Any, text: str, encoded: tuple[bool, NDArray[np.uint8]]) -> Any:
    return message_class("sensor_msgs/msg/CompressedImage")(header=header, format=text, data=encoded[1])
