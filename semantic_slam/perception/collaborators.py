"""Interfaces of the classifier's collaborators; any implementation with these methods can be used."""

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array, Bytes
from semantic_slam.perception.crops import square_crop
from semantic_slam.perception.frame import CameraModel
from semantic_slam.perception.range_bearing import RangeBearing

RangeBearingSensor = Callable[[Array, NDArray[np.float32] | None, CameraModel, Array], RangeBearing]
"""Function of a (4,) box, the depth image, the camera and its (7,) pose in the body frame: range and bearing."""


class FeatureExtractor(Protocol):
    """A learned semantic feature of a crop, in place of the mean class probabilities."""

    @property
    def input_size(self) -> int:
        """Side length of the input crops in pixels."""

    @property
    def num_features(self) -> int:
        """Number of feature components F."""

    def features(self, crops: Bytes) -> Array:
        """(N, F) features of (N, size, size, 3) RGB bytes."""


class CoverageCheck(Protocol):
    """Novelty check by class models: whether they explain a feature from some (unknown) viewpoint."""

    def explain(self, feature: Array, feature_covariance: Array) -> bool:
        """Whether some class in some direction explains a feature (F,) with its dropout covariance (F, F)."""


class AppearanceCheck(Protocol):
    """Novelty check by appearance: whether an image looks like known objects, whatever class the network predicts."""

    def recognise(self, feature: Array) -> bool:
        """Whether the trunk features (K,) of a crop are like those of known objects."""


def crop_features(extractor: FeatureExtractor, image: Bytes, boxes: Array) -> Array:
    """(D, F) learned features of the objects in (D, 4) boxes of an RGB image."""
    size = extractor.input_size
    crops = np.array([square_crop(image, box, size) for box in boxes], dtype=np.uint8)
    return extractor.features(crops.reshape(len(boxes), size, size, 3))
