"""The noise of a camera, of its depth sensor and of a detector, new in every frame."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array

DEPTH_WINDOW_PX = 8
"""A structured-light sensor matches windows: errors of neighbouring pixels are one error."""
NEAREST_DEPTH_M = 0.4


@dataclass(frozen=True)
class SensorNoise:
    """Standard deviations in each frame."""

    sigma_image: float = 3.0  # of a colour value, 0..255
    sigma_depth_m: float = 0.0012  # at NEAREST_DEPTH_M
    sigma_depth_per_m2: float = 0.0019  # and so much more with the square of the distance beyond
    sigma_box: float = 0.01  # of a box edge, as a fraction of the box's size


def noisy_image(image: NDArray[np.uint8], noise: SensorNoise, rng: np.random.Generator) -> NDArray[np.uint8]:
    """(H, W, 3) with independent noise in every value."""
    values = image + rng.normal(0.0, noise.sigma_image, image.shape)
    return np.clip(np.round(values), 0, 255).astype(np.uint8)


def noisy_depth_m(depth_m: NDArray[np.float32], noise: SensorNoise, rng: np.random.Generator) -> NDArray[np.float32]:
    """(H, W) with noise that grows with the distance and is one value in a matching window; NaN stays NaN."""
    height, width = depth_m.shape
    coarse = rng.standard_normal((height // DEPTH_WINDOW_PX + 2, width // DEPTH_WINDOW_PX + 2)).astype(np.float32)
    equal = np.asarray(cv2.resize(coarse, (width, height), interpolation=cv2.INTER_NEAREST), dtype=np.float32)
    sigma = noise.sigma_depth_m + noise.sigma_depth_per_m2 * (depth_m - NEAREST_DEPTH_M) ** 2
    return np.asarray(depth_m + sigma * equal, dtype=np.float32)


def noisy_boxes(boxes: Array, noise: SensorNoise, rng: np.random.Generator) -> Array:
    """(D, 4) boxes x_min y_min x_max y_max whose edges are each a little off."""
    sizes = np.tile(boxes[:, 2:] - boxes[:, :2], 2)
    return np.asarray(boxes + noise.sigma_box * sizes * rng.standard_normal(boxes.shape))
