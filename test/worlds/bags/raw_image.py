"""Pictures as drivers publish them, not compressed."""

from typing import Any

import numpy as np

from semantic_slam.messages.typestore import message_class


def raw_image(header: Any, pixels: np.ndarray, encoding: str) -> Any:
    """sensor_msgs/Image of (height, width) or (height, width, channels) pixels, of the type that the encoding has."""
    return message_class("sensor_msgs/msg/Image")(
        header=header,
        height=pixels.shape[0],
        width=pixels.shape[1],
        encoding=encoding,
        is_bigendian=0,
        step=pixels[0].nbytes,
        data=np.frombuffer(pixels.tobytes(), np.uint8),
    )
