"""Detection statistics of a detector, estimated from earlier runs."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, kw_only=True)
class DetectionValues:
    """Estimates that replace the configured values in the next run; None or empty: too little data."""

    probability: float | None = None  # detection probability at zero range, in the best direction, unoccluded
    half_range_m: float | None = None  # range at which it has halved; None: constant over the region
    persistence: float | None = None  # correlation of detectability between keyframes
    by_direction: tuple[float, ...] = ()  # shares of ``probability``, evenly from right to left edge
    field_of_view_rad: float | None = None  # field of view of ``by_direction``

    def over(self, field_of_view_rad: float) -> tuple[float, ...]:
        """``by_direction`` resampled to another field of view; beyond the edges of its own, the edge values hold."""
        if not self.by_direction or self.field_of_view_rad is None:
            return ()
        even = np.linspace(-1.0, 1.0, len(self.by_direction))
        return tuple(np.interp(field_of_view_rad * even, self.field_of_view_rad * even, self.by_direction).tolist())


UNTOLD = DetectionValues()
