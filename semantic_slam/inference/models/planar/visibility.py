"""P(beta | x, o): where an object can be observed."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array


@dataclass(frozen=True)
class PlanarVisibility:
    """P(beta | x, o): constant inside range and field of view, zero outside; 0 switches a limit off."""

    max_range_m: float = 0.0
    field_of_view_rad: float = 0.0
    softness: float = 0.1  # width of the logistic edge relative to the limit

    @property
    def is_limited(self) -> bool:
        """Whether some place is out of sight."""
        return self.max_range_m > 0.0 or self.field_of_view_rad > 0.0

    def log_probability(self, distance: Array, bearing: Array, *, soft: bool) -> Array:
        """(B,) from range [m] and bearing [rad] of the object."""
        total = np.zeros_like(distance)
        for value, limit in ((distance, self.max_range_m), (np.abs(bearing), self.field_of_view_rad / 2.0)):
            if limit > 0.0:
                margin = (limit - value) / (self.softness * limit)
                total = total + (_log_logistic(4.0 * margin) if soft else np.where(margin >= 0.0, 0.0, -np.inf))
        return total


def _log_logistic(value: Array) -> Array:
    return np.minimum(value, 0.0) - np.log1p(np.exp(-np.abs(value)))
