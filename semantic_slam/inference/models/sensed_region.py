"""The region in which a sensor detects, as far as its detections so far have shown it."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import wrap_angle

MARGIN_RAD = 0.1
"""Beyond the outermost bearings."""
RANGE_MARGIN = 1.1
"""Factor beyond the largest range, and below the least."""
LEAST_WIDTH_RAD = 0.5
"""Full angle at least, however little was detected."""
LEAST_DEPTH_M = 1.0
"""From the least to the largest range at least."""


@dataclass(frozen=True)
class SensedRegion:
    """Bounds of the detections so far: ranges, and bearings in the body frame from a first one on."""

    nearest_m: float
    farthest_m: float
    origin_rad: float  # the first bearing; the extremes are relative to it
    rightmost_rad: float
    leftmost_rad: float

    @classmethod
    def of(cls, ranges_m: Array, bearings_rad: Array, before: Self | None = None) -> Self | None:
        """With (D,) more detections; NaN ranges tell of bearings alone. None while there were none with a range."""
        known = ranges_m[np.isfinite(ranges_m)]
        if before is None:
            if not len(known):
                return None
            first = float(bearings_rad[0])
            before = cls(float(known[0]), float(known[0]), first, 0.0, 0.0)
        turns = wrap_angle(bearings_rad - before.origin_rad)
        return replace(
            before,
            nearest_m=float(min(before.nearest_m, known.min(initial=np.inf))),
            farthest_m=float(max(before.farthest_m, known.max(initial=0.0))),
            rightmost_rad=float(min(before.rightmost_rad, turns.min(initial=0.0))),
            leftmost_rad=float(max(before.leftmost_rad, turns.max(initial=0.0))),
        )

    def named(self) -> dict[str, float]:
        """The region as the configuration names it."""
        names = ("min_range_m", "max_range_m", "field_of_view_rad", "direction_rad")
        return {f"open_world.{name}": getattr(self, name) for name in names}

    @property
    def field_of_view_rad(self) -> float:
        """Full angle, with its margins."""
        width = self.leftmost_rad - self.rightmost_rad + 2.0 * MARGIN_RAD
        return min(max(width, LEAST_WIDTH_RAD), 2.0 * np.pi)

    @property
    def direction_rad(self) -> float:
        """Bearing of its middle in the body frame."""
        return float(wrap_angle(np.array(self.origin_rad + 0.5 * (self.leftmost_rad + self.rightmost_rad))))

    @property
    def min_range_m(self) -> float:
        """Least range, with its margin."""
        return self.nearest_m / RANGE_MARGIN

    @property
    def max_range_m(self) -> float:
        """Largest range, with its margin."""
        return max(self.farthest_m * RANGE_MARGIN, self.min_range_m + LEAST_DEPTH_M)
