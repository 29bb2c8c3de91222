"""How often a detector detects what is in view, as runs of it have shown."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, kw_only=True)
class DetectionValues:
    """What the next run takes in place of its configuration's; None or empty: too little was seen to tell."""

    probability: float | None = None  # right at the sensor, in its best direction, nothing hiding
    half_range_m: float | None = None  # where that is half as likely; None: the same everywhere in the region
    persistence: float | None = None  # of whether an object can be detected, from one keyframe to the next
    by_direction: tuple[float, ...] = ()  # shares of it, evenly from the right edge of a field of view to its left one
    field_of_view_rad: float | None = None  # which that is

    def over(self, field_of_view_rad: float) -> tuple[float, ...]:
        """``by_direction`` of another field of view, beyond the edges of its own as at them."""
        if not self.by_direction or self.field_of_view_rad is None:
            return ()
        even = np.linspace(-1.0, 1.0, len(self.by_direction))
        return tuple(np.interp(field_of_view_rad * even, self.field_of_view_rad * even, self.by_direction).tolist())


UNTOLD = DetectionValues()
