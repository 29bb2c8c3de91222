"""semantic_inference_msgs/FeatureImage: segments of a picture, each with a vector of appearance.

The package's FeatureVectors tell names and vectors without a stamp, its FeatureVectorStamped one vector of a whole
picture: neither shows an object.
"""

from typing import Any

import numpy as np

from semantic_slam.errors import MessageError
from semantic_slam.geometry.arrays import Array
from semantic_slam.messages.images import decode_numbers
from semantic_slam.messages.standard import stamp_ns
from semantic_slam.perception.frame import Detections

TYPE = "semantic_inference_msgs/msg/FeatureImage"


def from_feature_image(message: Any) -> Detections:
    """A detection without a label for each segment that shows: the box around it, and its vector.

    The image holds the number of each pixel's segment; ``mask_ids`` are those of the features, 1, 2, ... where it is
    empty. It has the size of the picture. Raises MessageError.
    """
    numbers = np.asarray(message.mask_ids, dtype=np.int64)
    if not len(numbers):
        numbers = 1 + np.arange(len(message.features))
    vectors = [np.asarray(feature.data, dtype=np.float64) for feature in message.features]
    if len(numbers) != len(vectors) or len({len(vector) for vector in vectors}) > 1:
        raise MessageError(
            f"{TYPE}: {len(numbers)} masks and {len(vectors)} features; send one vector for each, all of one length",
            "arrays of different lengths",
        )
    pixels = decode_numbers(message.image, TYPE)
    boxes = [_box(pixels == number) for number in numbers]
    shown = [row for row, box in enumerate(boxes) if box is not None]  # of what lies behind others nothing may show
    return Detections(
        stamp_ns=stamp_ns(message.header.stamp),
        frame_id=str(message.header.frame_id),
        boxes=np.array([boxes[row] for row in shown], dtype=np.float64).reshape(-1, 4),
        labels=("",) * len(shown),
        scores=np.ones(len(shown)),
        track_ids=("",) * len(shown),
        embeddings=np.array([vectors[row] for row in shown]).reshape(len(shown), len(vectors[0]) if vectors else 0),
    )


def _box(mask: Array) -> list[float] | None:
    """x_min y_min x_max y_max of the pixels of a mask, None where it has none."""
    y, x = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return [float(x[0]), float(y[0]), float(x[-1] + 1), float(y[-1] + 1)] if len(x) else None
