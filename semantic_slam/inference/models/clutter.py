"""Clutter: detections of no object in the map, such as false alarms, unmapped objects, and wrong identities.

Their positions are uniform over the sensor's region, an annular sector on the ground, or a cone in space without its
near part; beyond its largest range the density continues. Their scores are distributed as those of outliers.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from semantic_slam.configuration import OpenWorldConfiguration
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.states.spaces import LEAST_DISTANCE_M

ScoreDensity = Callable[[Sequence[Any]], Array]
"""(n,) log densities of the scores of n clutter detections, tempered as those of objects are."""


class Clutter(Protocol):
    """Densities of n clutter detections, in the units of the observation model."""

    def log_place(self, detections: Sequence[Any]) -> Array:
        """(n,) log density of the geometric measurement."""

    def log_scores(self, detections: Sequence[Any]) -> Array:
        """(n,) log density of the scores; 0 where scores are not evaluated."""


@dataclass(frozen=True)
class EvenClutter:
    """Uniform planar clutter: per metre and radian of range and bearing, or per radian of a bearing alone."""

    area_m2: float
    field_of_view_rad: float
    scores: ScoreDensity | None = None

    @classmethod
    def of(cls, region: OpenWorldConfiguration, scores: ScoreDensity | None) -> "EvenClutter":
        """Over the region that the configuration states."""
        area = 0.5 * region.field_of_view_rad * (region.max_range_m**2 - region.min_range_m**2)
        return cls(area, region.field_of_view_rad, scores)

    def log_place(self, detections: Sequence[Any]) -> Array:
        """(n,) log densities; uniform on the ground, so proportional to the range."""
        even = 1.0 / self.field_of_view_rad
        shares = [max(item.range_m, LEAST_DISTANCE_M) / self.area_m2 if item.has_range else even for item in detections]
        return np.asarray(np.log(np.array(shares, dtype=np.float64)))

    def log_scores(self, detections: Sequence[Any]) -> Array:
        """(n,) log densities, 0 without class models."""
        return np.zeros(len(detections)) if self.scores is None or not len(detections) else self.scores(detections)


@dataclass(frozen=True)
class EvenSpatialClutter:
    """Uniform clutter in space, per metre and square radian of range and ray, or per square radian of a ray alone."""

    volume_m3: float
    solid_angle: float  # [rad^2]
    scores: ScoreDensity | None = None

    @classmethod
    def of(cls, region: OpenWorldConfiguration, scores: ScoreDensity | None) -> "EvenSpatialClutter":
        """Over the region that the configuration states, whose field of view is the full angle of a cone."""
        solid_angle = 2.0 * np.pi * (1.0 - np.cos(0.5 * region.field_of_view_rad))
        volume = solid_angle * (region.max_range_m**3 - region.min_range_m**3) / 3.0
        return cls(float(volume), float(solid_angle), scores)

    def log_place(self, detections: Sequence[Any]) -> Array:
        """(n,) log densities; uniform in volume, so proportional to the squared range; a ray alone has no range."""
        ranged = np.array([item.has_range for item in detections], dtype=bool)
        ranges = [max(item.range_m, LEAST_DISTANCE_M) if item.has_range else 1.0 for item in detections]
        log_shares = 2.0 * np.log(np.array(ranges, dtype=np.float64)) - np.log(self.volume_m3)
        return np.asarray(np.where(ranged, log_shares, -np.log(self.solid_angle)), dtype=np.float64)

    def log_scores(self, detections: Sequence[Any]) -> Array:
        """(n,) log densities, 0 without class models."""
        return np.zeros(len(detections)) if self.scores is None or not len(detections) else self.scores(detections)
