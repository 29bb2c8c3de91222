"""Square network crops from detector boxes."""

import cv2
import numpy as np

from semantic_slam.geometry.arrays import Array, Bytes, Flags

MARGIN = 0.1
"""Background margin on either side of the box, as a fraction of its longer side."""


IN_SHARES = "box within the first pixel, as one in shares of the image is; give boxes in pixels"


def are_in_shares(boxes: Array) -> Flags:
    """(...,) whether boxes (..., 4) appear to be in normalised coordinates: all lie around the first pixel."""
    return np.asarray((boxes.min(axis=-1) >= -0.5) & (boxes.max(axis=-1) <= 1.5))


def box_fault(box: Array, width: int, height: int) -> str:
    """Why a box (x_min, y_min, x_max, y_max) cannot be used in an image of that size; "" when it can."""
    if not np.all(np.isfinite(box)):
        return "box that is not finite"
    if box[2] <= box[0] or box[3] <= box[1]:
        return "box without area"
    if are_in_shares(box):
        return IN_SHARES
    if box[0] >= width or box[1] >= height or box[2] <= 0 or box[3] <= 0:
        return "box outside the image"
    return ""


def square_crop(image: Bytes, box: Array, size: int) -> Bytes:
    """(size, size, 3) crop around a usable box with margin, which keeps the object's aspect ratio.

    Areas outside the image replicate the border. Downscaling averages pixels, which avoids aliasing.
    """
    height, width = image.shape[:2]
    x_min, x_max = np.clip(box[[0, 2]], 0, width)
    y_min, y_max = np.clip(box[[1, 3]], 0, height)
    half = max(0.5 * (1.0 + 2.0 * MARGIN) * max(x_max - x_min, y_max - y_min), 1.0)
    corner_x, corner_y = round(0.5 * (x_min + x_max) - half), round(0.5 * (y_min + y_max) - half)
    side = max(round(2.0 * half), 2)
    window = _padded_window(image, corner_x, corner_y, side)
    method = cv2.INTER_AREA if side > size else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(window, (size, size), interpolation=method), dtype=np.uint8)


def _padded_window(image: Bytes, x: int, y: int, side: int) -> Bytes:
    height, width = image.shape[:2]
    left, top = max(-x, 0), max(-y, 0)
    right, bottom = max(x + side - width, 0), max(y + side - height, 0)
    inner = image[y + top : y + side - bottom, x + left : x + side - right]
    if not (left or top or right or bottom):
        return inner
    return np.asarray(cv2.copyMakeBorder(inner, top, bottom, left, right, cv2.BORDER_REPLICATE), dtype=np.uint8)
