"""The sensor's field of view and range limits, estimated from its detections so far.

Detections bound the region from inside alone, and a few of them only loosely: if the region were taken to be as small
as one detection shows, a false alarm in it would be as likely as a known object.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import wrap_angle

MARGIN_RAD = 0.1
"""Least margin beyond the outermost bearings, however many there are, as bearings have errors."""
RANGE_MARGIN = 1.1
"""Least margin factor beyond the largest and below the smallest range."""
LEAST_WIDTH_RAD, MOST_WIDTH_RAD = 0.5, 2.0 * np.pi
"""Bounds of the full angle, whose prior is log-uniform between them."""
LEAST_DEPTH_M = 1.0
"""Least difference between the largest and smallest range."""
RANGES, ANGLES = ("min_range_m", "max_range_m"), ("field_of_view_rad", "direction_rad")
"""Names of the bounds, as in the configuration."""


@dataclass(frozen=True)
class SensedRegion:
    """Extremes of the detections so far: ranges, and bearings in the body frame relative to the first one.

    The size of the region is its expectation given these extremes and n detections, uniform in it.
    """

    nearest_m: float
    farthest_m: float
    origin_rad: float  # the first bearing; the extremes are relative to it
    rightmost_rad: float
    leftmost_rad: float
    num_ranges: int  # detections with a range
    num_bearings: int  # detections
    most_m: float = float("inf")  # range beyond which detections are left out

    @classmethod
    def of(
        cls, ranges_m: Array, bearings_rad: Array, before: Self | None = None, most_m: float = float("inf")
    ) -> Self | None:
        """With (D,) more detections; a NaN range is a bearing alone. None until there was one.

        Those beyond ``most_m``, which the first call sets, tell nothing.
        """
        near = ~(ranges_m > (most_m if before is None else before.most_m))
        ranges_m, bearings_rad = ranges_m[near], bearings_rad[near]
        known = ranges_m[np.isfinite(ranges_m)]
        if before is None:
            if not len(bearings_rad):
                return None
            before = cls(float("inf"), 0.0, float(bearings_rad[0]), 0.0, 0.0, 0, 0, most_m)
        turns = wrap_angle(bearings_rad - before.origin_rad)
        return replace(
            before,
            nearest_m=float(min(before.nearest_m, known.min(initial=np.inf))),
            farthest_m=float(max(before.farthest_m, known.max(initial=0.0))),
            rightmost_rad=float(min(before.rightmost_rad, turns.min(initial=0.0))),
            leftmost_rad=float(max(before.leftmost_rad, turns.max(initial=0.0))),
            num_ranges=before.num_ranges + len(known),
            num_bearings=before.num_bearings + len(turns),
        )

    def bounds(self) -> dict[str, float]:
        """What detections tell of the region by the names of its configuration parameters; bearings alone: no range."""
        names = (*(RANGES if self.num_ranges else ()), *ANGLES)
        return {name: getattr(self, name) for name in names}

    def named(self) -> dict[str, float]:
        """The :meth:`bounds`, as a belief names them."""
        return {f"open_world.{name}": bound for name, bound in self.bounds().items()}

    @property
    def is_settled(self) -> bool:
        """Whether the detections are so many that the region is not expected to go on beyond its margins."""
        least = max(self._spread_rad, LEAST_WIDTH_RAD)
        is_wide = _width(self._spread_rad, self.num_bearings) > min(least + 2.0 * MARGIN_RAD, MOST_WIDTH_RAD)
        return not is_wide and (not self.num_ranges or 1.0 + 1.0 / self.num_ranges <= RANGE_MARGIN**2)

    @property
    def field_of_view_rad(self) -> float:
        """Full angle W: 1 / E[1 / W], the inverse of the expected uniform density in it; with margins."""
        spread = self._spread_rad
        return min(max(_width(spread, self.num_bearings), spread + 2.0 * MARGIN_RAD), MOST_WIDTH_RAD)

    @property
    def _spread_rad(self) -> float:
        return self.leftmost_rad - self.rightmost_rad

    @property
    def direction_rad(self) -> float:
        """Bearing of the region's middle in the body frame."""
        return float(wrap_angle(np.array(self.origin_rad + 0.5 * (self.leftmost_rad + self.rightmost_rad))))

    @property
    def min_range_m(self) -> float:
        """Smallest range: below the nearest of n by the area that a uniform density lets expect; with its margin."""
        expected = ((self.num_ranges + 1) * self.nearest_m**2 - self._largest_squared) / self.num_ranges
        return min(self.nearest_m / RANGE_MARGIN, float(np.sqrt(max(expected, 0.0))))

    @property
    def max_range_m(self) -> float:
        """Largest range, with its margin."""
        return min(max(float(np.sqrt(self._largest_squared)), self.min_range_m + LEAST_DEPTH_M), self.most_m)

    @property
    def _largest_squared(self) -> float:
        """[m^2] R^2 = 1 / E[1 / R^2] = r^2 (n + 1) / n, r being the farthest of n, with a log-uniform prior of R."""
        return self.farthest_m**2 * max(1.0 + 1.0 / self.num_ranges, RANGE_MARGIN**2)


def _width(spread: float, count: int) -> float:
    """[rad] 1 / E[1 / W] of an interval anywhere, given that ``count`` uniform draws in it span ``spread``.

    The likelihood of these is (W - spread) / W^count, up to a constant.
    """
    least = max(spread, LEAST_WIDTH_RAD)
    if least >= MOST_WIDTH_RAD:
        return MOST_WIDTH_RAD
    share, most = spread / least, MOST_WIDTH_RAD / least
    one, two, three = (_integral(power, most) for power in (count, count + 1, count + 2))
    return least * (one - share * two) / (two - share * three)


def _integral(power: int, most: float) -> float:
    """Integral of x^-power from 1 to ``most``."""
    if power == 1:
        return float(np.log(most))
    return float((1.0 - most ** (1.0 - power)) / (power - 1.0))
