"""Camera model from sensor_msgs/CameraInfo, of raw pictures or of rectified ones."""

from typing import Any

import numpy as np

from semantic_slam.errors import MessageError
from semantic_slam.geometry import so3
from semantic_slam.geometry.arrays import Array
from semantic_slam.perception.frame import CameraModel
from semantic_slam.reasons import quoted

DISTORTION_MODELS = ("plumb_bob", "rational_polynomial", "")
NUMBERS_OF_COEFFICIENTS = (4, 5, 8, 12, 14)
"""Lengths of D that OpenCV's model of those lenses has."""
ROTATION_TOLERANCE = 1e-3
"""Largest entry of R R^T - 1 that rounding leaves in a calibration file."""
USE_RECTIFIED = "use rectified images and set perception.rectified: true"


def camera_model(message: Any, topic: str, *, rectified: bool = False) -> CameraModel:
    """Intrinsics of a sensor_msgs/CameraInfo; raises MessageError for those that tell no camera.

    ``rectified``: the pictures are those of image_proc or stereo_image_proc, which come with the camera_info of the raw
    ones. By the definition of sensor_msgs/CameraInfo P then has the intrinsics, no distortion is left, and R turns the
    raw camera, whose frame the header names, into that of the pictures. Otherwise K and D count.
    """
    fx, fy, cx, cy = _of_rectified(message, topic) if rectified else _of_raw(message, topic)
    return CameraModel(
        width=int(message.width),
        height=int(message.height),
        fx=fx,
        fy=fy,
        cx=cx,
        cy=cy,
        distortion=() if rectified else _distortion(message, topic),
        frame_id=message.header.frame_id,
        rectification=_rectification(message, topic) if rectified else CameraModel.rectification,
    )


def _of_raw(message: Any, topic: str) -> tuple[float, float, float, float]:
    """Elements fx, fy, cx, cy of K."""
    k = np.asarray(message.k, dtype=np.float64)
    if not _are_intrinsics(k, k[0], k[4]):
        raise _refused(topic, "the camera is not calibrated", f"fx {k[0]:g}, fy {k[4]:g}", "calibrate it")
    return float(k[0]), float(k[4]), float(k[2]), float(k[5])


def _of_rectified(message: Any, topic: str) -> tuple[float, float, float, float]:
    """Elements fx, fy, cx, cy of P."""
    p = np.asarray(message.p, dtype=np.float64)
    if not _are_intrinsics(p, p[0], p[5]):
        remedy = "calibrate the camera with P, or set perception.rectified: false for raw images"
        raise _refused(topic, "P tells no rectified picture", f"fx {p[0]:g}, fy {p[5]:g}", remedy)
    return float(p[0]), float(p[5]), float(p[2]), float(p[6])


def _are_intrinsics(matrix: Array, fx: float, fy: float) -> bool:
    return bool(np.isfinite(matrix).all() and fx > 0.0 and fy > 0.0)


def _distortion(message: Any, topic: str) -> tuple[float, ...]:
    """Coefficients D of the lens; () where it distorts nothing."""
    coefficients = tuple(float(value) for value in message.d)
    if not any(coefficients):
        return ()
    if message.distortion_model not in DISTORTION_MODELS:
        raise _refused(topic, "the distortion model is not known", quoted(message.distortion_model), USE_RECTIFIED)
    if len(coefficients) not in NUMBERS_OF_COEFFICIENTS or not np.isfinite(coefficients).all():
        told = " ".join(f"{value:g}" for value in coefficients[:8])
        what = "the distortion D is not 4, 5, 8, 12 or 14 finite numbers"
        raise _refused(topic, what, told, f"calibrate the camera, or {USE_RECTIFIED}")
    return coefficients


def _rectification(message: Any, topic: str) -> tuple[float, float, float, float]:
    """R as a quaternion."""
    matrix = np.asarray(message.r, dtype=np.float64).reshape(3, 3)
    error = np.abs(matrix @ matrix.T - np.eye(3)).max()
    if not (error < ROTATION_TOLERANCE and np.linalg.det(matrix) > 0.0):  # NaN is none
        remedy = "calibrate the camera, or set perception.rectified: false for raw images"
        raise _refused(topic, "R is not a rotation", " ".join(f"{value:g}" for value in matrix.flat), remedy)
    x, y, z, w = so3.from_matrix(matrix).tolist()
    return x, y, z, w


def _refused(topic: str, what: str, told: str, remedy: str) -> MessageError:
    """The error of one line; runs count it by fault and remedy, whatever is ``told``."""
    return MessageError(f"{topic}: {what} ({told}); {remedy}", kind=f"{what}, {remedy}")
