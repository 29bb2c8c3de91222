"""GTSAM factors of the planar observation model."""

from collections.abc import Callable
from typing import Any

import gtsam

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.custom_factor import Sighting, custom_factor
from semantic_slam.inference.models.observation import Linearisation
from semantic_slam.inference.models.planar.detection import PlanarDetection
from semantic_slam.inference.states.spaces import Spaces


def range_factor(detection: PlanarDetection, keys: tuple[int, int]) -> Any:
    """Built-in bearing-range factor between two poses."""
    return gtsam.BearingRangeFactorPose2(*keys, detection.direction, detection.range_m, detection.noise)


def point_range_factor(detection: PlanarDetection, keys: tuple[int, int]) -> Any:
    """Built-in bearing-range factor between a pose and a point."""
    return gtsam.BearingRangeFactor2D(*keys, detection.direction, detection.range_m, detection.noise)


def bearing_factor(spaces: Spaces, linearise: Callable[[Array, Array], Linearisation], sighting: Sighting) -> Any:
    """Factor on robot and landmark of a measured bearing alone."""
    return custom_factor(spaces, linearise, sighting, slice(1, 2), 1)
