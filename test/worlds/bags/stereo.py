"""Depth images as the disparities of a stereo pair, of which they would be."""

from typing import Any

import cv2
import numpy as np
from worlds.bags.bag_factory import Entry
from worlds.bags.raw_image import raw_image

from semantic_slam.messages import topics
from semantic_slam.messages.typestore import message_class

FOCAL_PX, BASELINE_M = 100.0, 0.12


def disparity_message(header: Any, disparities: np.ndarray, **changes: Any) -> Any:
    """stereo_msgs/DisparityImage of (height, width) disparities [px]; ``changes`` to its fields."""
    image = raw_image(header, disparities.astype(np.float32), "32FC1")
    whole = message_class("sensor_msgs/msg/RegionOfInterest")(
        x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
    )
    limits = {"min_disparity": 0.0, "max_disparity": 128.0, "delta_d": 0.0625}
    fields = {"f": FOCAL_PX, "t": BASELINE_M, "valid_window": whole, **limits, **changes}
    return message_class("stereo_msgs/msg/DisparityImage")(header=header, image=image, **fields)


def disparity_of(message: Any) -> Any:
    """A depth png in millimetres as disparities; where it has no depth, -1 as OpenCV's matchers have it."""
    metres = cv2.imdecode(np.asarray(message.data), cv2.IMREAD_UNCHANGED) / 1000.0
    with np.errstate(divide="ignore"):
        return disparity_message(message.header, np.where(metres > 0.0, FOCAL_PX * BASELINE_M / metres, -1.0))


def by_stereo(entries: list[Entry]) -> list[Entry]:
    """The entries with disparities in the place of depth images."""
    found = []
    for entry in entries:
        is_depth = entry.topic == topics.DEPTH_COMPRESSED
        found.append(Entry(topics.DISPARITY, disparity_of(entry.message), entry.stamp_ns) if is_depth else entry)
    return found
