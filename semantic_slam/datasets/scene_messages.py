"""Sensor messages of an imported scene."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np

from semantic_slam.errors import InputError
from semantic_slam.messages.picture_files import read_picture
from semantic_slam.messages.standard import header_message
from semantic_slam.messages.typestore import message_class
from semantic_slam.perception.frame import CameraModel

JPEG_QUALITY = 90
FORMATS = {".jpg": "jpeg", ".png": "16UC1; png"}
OPTICAL_QUATERNION = (-0.5, 0.5, -0.5, 0.5)
"""R_base_optical: z forward becomes x, x right becomes -y, y down becomes -z (REP-103)."""


def compressed_image(path: Path, scale: float, stamp_ns: int, frame_id: str, interpolation: int) -> Any:
    """sensor_msgs/CompressedImage of a picture file: its own bytes, or scaled and encoded again."""
    try:
        data = path.read_bytes()
    except OSError as fault:
        raise InputError(f"{path}: {fault.strerror}; restore it from the data set") from None
    if scale != 1.0:
        data = _scaled(path, scale, interpolation)
    return encoded_image(data, path.suffix, stamp_ns, frame_id)


def encoded_image(data: bytes, suffix: str, stamp_ns: int, frame_id: str) -> Any:
    """sensor_msgs/CompressedImage of an encoded picture, ``.jpg`` in colour or ``.png`` with depth."""
    return message_class("sensor_msgs/msg/CompressedImage")(
        header=header_message(stamp_ns, frame_id), format=FORMATS[suffix], data=np.frombuffer(data, dtype=np.uint8)
    )


def _scaled(path: Path, scale: float, interpolation: int) -> bytes:
    picture = read_picture(path, cv2.IMREAD_UNCHANGED)
    size = (round(picture.shape[1] * scale), round(picture.shape[0] * scale))
    small = cv2.resize(picture, size, interpolation=interpolation)
    options = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY] if path.suffix == ".jpg" else []
    return bytes(cv2.imencode(path.suffix, small, options)[1])


def camera_info(camera: CameraModel, scale: float, stamp_ns: int, frame_id: str) -> Any:
    """sensor_msgs/CameraInfo of images scaled by ``scale``; pixel centres have whole coordinates."""
    fx, fy = camera.fx * scale, camera.fy * scale
    cx, cy = ((value + 0.5) * scale - 0.5 for value in (camera.cx, camera.cy))
    region = message_class("sensor_msgs/msg/RegionOfInterest")(
        x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
    )
    return message_class("sensor_msgs/msg/CameraInfo")(
        header=header_message(stamp_ns, frame_id),
        height=round(camera.height * scale),
        width=round(camera.width * scale),
        distortion_model="plumb_bob",
        d=np.array((*camera.distortion, 0.0, 0.0, 0.0, 0.0, 0.0)[:5]),
        k=np.array([fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]),
        r=np.eye(3).ravel(),
        p=np.array([fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]),
        binning_x=0,
        binning_y=0,
        roi=region,
    )


def static_transform(stamp_ns: int, parent: str, child: str, height_m: float) -> Any:
    """tf2_msgs/TFMessage of an optical frame that looks along its parent's x axis, ``height_m`` above its origin."""
    x, y, z, w = OPTICAL_QUATERNION
    transform = message_class("geometry_msgs/msg/Transform")(
        translation=message_class("geometry_msgs/msg/Vector3")(x=0.0, y=0.0, z=height_m),
        rotation=message_class("geometry_msgs/msg/Quaternion")(x=x, y=y, z=z, w=w),
    )
    stamped = message_class("geometry_msgs/msg/TransformStamped")(
        header=header_message(stamp_ns, parent), child_frame_id=child, transform=transform
    )
    return message_class("tf2_msgs/msg/TFMessage")(transforms=[stamped])
