"""What a classifier is handed: whatever has these methods serves, from this project or another."""

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array, Bytes
from semantic_slam.perception.crops import square_crop
from semantic_slam.perception.frame import CameraModel
from semantic_slam.perception.range_bearing import RangeBearing

RangeBearingSensor = Callable[[Array, NDArray[np.float32] | None, CameraModel, Array], RangeBearing]
"""From a (4,) box, the depth image, the camera and its (7,) pose in the body frame to a range and a bearing."""


class FeatureExtractor(Protocol):
    """A learned semantic feature of a crop, in place of the mean class probabilities."""

    @property
    def input_size(self) -> int:
        """Pixels on a side of its crops."""

    @property
    def num_features(self) -> int:
        """F, components of the feature."""

    def features(self, crops: Bytes) -> Array:
        """(N, F) of (N, size, size, 3) RGB bytes."""


class CoverageCheck(Protocol):
    """Whether the class models know a feature: novelty that shows in a picture whose viewpoint is not known."""

    def explain(self, feature: Array, feature_covariance: Array) -> bool:
        """Whether some class shows a feature (F,) with its dropout covariance (F, F) in some direction."""


class AppearanceCheck(Protocol):
    """Whether a picture looks like those of known objects: novelty that shows whatever classes the network names."""

    def recognise(self, feature: Array) -> bool:
        """Whether the trunk's features (K,) of a crop are like those of known objects."""


def crop_features(extractor: FeatureExtractor, image: Bytes, boxes: Array) -> Array:
    """(D, F) learned features of the objects in (D, 4) boxes of an RGB image."""
    size = extractor.input_size
    crops = np.array([square_crop(image, box, size) for box in boxes], dtype=np.uint8)
    return extractor.features(crops.reshape(len(boxes), size, size, 3))
