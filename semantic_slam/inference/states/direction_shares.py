"""How much less often a sensor detects in some directions than in its best one: at a picture's edge, behind dirt."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from semantic_slam.configuration import OpenWorldConfiguration
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import wrap_angle


def even_directions(count: int, field_of_view_rad: float) -> Array:
    """(count,) bearings off the middle of a region, from its right edge to its left one."""
    return np.asarray(0.5 * field_of_view_rad * np.linspace(-1.0, 1.0, count))


@dataclass(frozen=True, kw_only=True)
class DirectionShares:
    """Shares of the detection probability in S directions, linear between them; none where it is the same in all."""

    off_centre_rad: Array  # (S,) ascending, off the middle of the sensor's region
    shares: Array  # (S,)

    @classmethod
    def of(cls, settings: OpenWorldConfiguration) -> Self:
        """As configured, evenly over the field of view."""
        shares = np.array(settings.detection_by_direction, dtype=np.float64)
        return cls(off_centre_rad=even_directions(len(shares), settings.field_of_view_rad), shares=shares)

    def times(self, probabilities: Array, relative: Array, direction_rad: float | Array) -> Array:
        """(..., G) probabilities of positions (..., 2) relative to the robot, as much smaller as their directions say.

        ``direction_rad`` (...,): where the middle of the sensor's region is, in the frame of the positions.
        """
        if not len(self.shares):
            return probabilities
        off_centre = wrap_angle(np.arctan2(relative[..., 1], relative[..., 0]) - direction_rad)
        return np.asarray(probabilities * self.at(off_centre)[..., None])

    def at(self, off_centre_rad: Array) -> Array:
        """(...,) in directions off the middle of the region."""
        if not len(self.shares):
            return np.ones(np.shape(off_centre_rad))
        return np.asarray(np.interp(off_centre_rad, self.off_centre_rad, self.shares))


ALIKE = DirectionShares(off_centre_rad=np.zeros(0), shares=np.zeros(0))
"""As often in every direction."""
