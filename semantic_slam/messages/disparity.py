"""Depth by stereo: stereo_msgs/DisparityImage of a rectified pair as depth of its left image."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from semantic_slam.errors import MessageError

ENCODING = "32FC1"
"""Encoding of the disparities, as the message prescribes it."""
UNIT_REMEDY = "correct its focal length f in pixels and its baseline T in metres"
"""What to do where depth by disparities is implausible in metres."""


def is_disparity(message: Any) -> bool:
    """Whether a message is a DisparityImage, and not an image of depth or colour."""
    return hasattr(message, "min_disparity")


def depth_of_disparity(message: Any, disparities: NDArray[np.float32], topic: str) -> NDArray[np.float32]:
    """(height, width) metres along the optical axis, Z = f T / d, of (height, width) disparities d [px]; NaN: invalid.

    Invalid are disparities that are not finite, not positive or below ``min_disparity``, those outside the window
    ``valid_window``, where it has a size, and those so small that the depth is no number of 32 bits. Raises
    MessageError for a focal length f [px] or a baseline T [m] that is not positive.
    """
    scale = float(message.f) * float(message.t)
    if not (np.isfinite(scale) and message.f > 0.0 and message.t > 0.0):
        raise MessageError(
            f"{topic}: focal length {message.f:g} px and baseline {message.t:g} m tell no depth; give f and T above 0"
        )
    is_valid = np.isfinite(disparities) & (disparities > 0.0) & (disparities >= message.min_disparity)
    depth_m = np.full(disparities.shape, np.nan, dtype=np.float32)
    with np.errstate(over="ignore"):
        np.divide(np.float32(scale), disparities, out=depth_m, where=is_valid)
    depth_m[np.isinf(depth_m)] = np.nan
    window = message.valid_window
    if window.width and window.height:
        left, top = window.x_offset, window.y_offset
        inside = np.zeros(disparities.shape, dtype=np.bool_)
        inside[top : top + window.height, left : left + window.width] = True
        depth_m[~inside] = np.nan
    return depth_m
