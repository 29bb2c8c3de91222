"""A hypothesis's belief over the correlated detection errors, passed from one frame with detections to the next."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from semantic_slam.configuration import DetectionErrorsConfiguration
from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.pose import wrap_angle


@dataclass(frozen=True, kw_only=True)
class PropagatedErrors:
    """Mean of the correlated errors f at n places, those of the newest detections first; ``models/correlated_errors``.

    The covariance is in ``TrackedStates.propagated_covariance``.
    """

    keyframe: int  # of the newest detections
    places: Array  # (n, 2) in metres, in the body frame of the newest keyframe
    by_sensor: Array  # (2 n, d) Jacobian of f by the sensor's constant errors g
    left_of_each: Array  # (n,) correlation in that frame with the last detection at each place
    mean: Array  # (2 n + d,) of f, then of g
    left: float = 1.0  # correlation that is left after the motion since that frame

    @property
    def count(self) -> int:
        """Number of two-component entries, n places and the sensor's."""
        return len(self.mean) // 2

    def slopes_at(self, rows: Index) -> Array:
        """(2 k, d) Jacobian of f at k of the places by the sensor's constant errors."""
        return np.asarray(self.by_sensor[(2 * rows[:, None] + np.arange(2)).ravel()])

    def moved(self, control: Array, settings: DetectionErrorsConfiguration) -> Self:
        """Propagate through a motion ``control`` (3,): x, y [m], yaw [rad]; the correlation decays with it."""
        cos, sin = np.cos(control[2]), np.sin(control[2])
        turned_back = np.array([[cos, sin], [-sin, cos]])
        driven, turned = float(np.hypot(*control[:2])), abs(float(wrap_angle(control[2])))
        left = self.left * float(np.exp(-driven / settings.motion_m - turned / settings.motion_rad))
        return replace(self, places=(self.places - control[:2]) @ turned_back.T, left=left)
