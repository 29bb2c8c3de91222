"""Dependence of the detection probability on the bearing, e.g. at an image's edge or behind dirt on the lens."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from semantic_slam.configuration import OpenWorldConfiguration
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import wrap_angle


def even_directions(count: int, field_of_view_rad: float) -> Array:
    """(count,) evenly spaced bearings relative to the middle of a region, from its right edge to its left one."""
    return np.asarray(0.5 * field_of_view_rad * np.linspace(-1.0, 1.0, count))


@dataclass(frozen=True, kw_only=True)
class DirectionShares:
    """Factors on the detection probability in S directions, interpolated linearly; S = 0: no dependence."""

    off_centre_rad: Array  # (S,) ascending bearings relative to the middle of the sensor's region
    shares: Array  # (S,) factors

    @classmethod
    def of(cls, settings: OpenWorldConfiguration) -> Self:
        """The configured factors, evenly spaced over the field of view."""
        shares = np.array(settings.detection_by_direction, dtype=np.float64)
        return cls(off_centre_rad=even_directions(len(shares), settings.field_of_view_rad), shares=shares)

    def times(self, probabilities: Array, relative: Array, direction_rad: float | Array) -> Array:
        """Multiply (..., G) probabilities by the factors for positions (..., 2) relative to the robot.

        ``direction_rad`` (...,): direction of the middle of the sensor's region, in the frame of the positions.
        """
        if not len(self.shares):
            return probabilities
        off_centre = wrap_angle(np.arctan2(relative[..., 1], relative[..., 0]) - direction_rad)
        return np.asarray(probabilities * self.at(off_centre)[..., None])

    def at(self, off_centre_rad: Array) -> Array:
        """(...,) factors at bearings relative to the middle of the region."""
        if not len(self.shares):
            return np.ones(np.shape(off_centre_rad))
        return np.asarray(np.interp(off_centre_rad, self.off_centre_rad, self.shares))


ALIKE = DirectionShares(off_centre_rad=np.zeros(0), shares=np.zeros(0))
"""No dependence on the direction."""
