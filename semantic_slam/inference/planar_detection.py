"""A detection as the planar observation model takes it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PlanarDetection:
    """One detection, in the body frame."""

    range_m: float  # NaN: bearing only
    bearing_rad: float  # seen from the body's origin, or from ``sensor`` when bearing only
    covariance: Array  # (2, 2) of [range, bearing]
    sensor: Array  # (2,) camera in the body frame, metres
    feature: Array  # (F,) z_sem
    feature_covariance: Array  # (F, F) covariance of the dropout samples

    @property
    def has_range(self) -> bool:
        return bool(np.isfinite(self.range_m))

    @property
    def origin(self) -> Array:
        """(2,) point of the body that range and bearing are seen from."""
        return np.zeros(2) if self.has_range else self.sensor
