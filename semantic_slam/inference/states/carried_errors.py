"""What a hypothesis knows of the errors that repeat, from one frame with detections to the next."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from semantic_slam.configuration import DetectionErrorsConfiguration
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import wrap_angle


@dataclass(frozen=True, kw_only=True)
class CarriedErrors:
    """f of the newest frame with detections, n of them, as a hypothesis knows it; its covariance stands elsewhere."""

    keyframe: int  # of that frame
    places: Array  # (n, 2) metres, in the body frame of the newest keyframe
    by_sensor: Array  # (2 n, d) slopes by what the sensor gets wrong all the way
    mean: Array  # (2 n + d,), of which the last d are that
    left: float = 1.0  # correlation that the motion since has left

    @property
    def count(self) -> int:
        """Entries of two components."""
        return len(self.mean) // 2

    def moved(self, control: Array, settings: DetectionErrorsConfiguration) -> Self:
        """After a motion (3,): x, y [m], yaw [rad]."""
        cos, sin = np.cos(control[2]), np.sin(control[2])
        turned_back = np.array([[cos, sin], [-sin, cos]])
        driven, turned = float(np.hypot(*control[:2])), abs(float(wrap_angle(control[2])))
        left = self.left * float(np.exp(-driven / settings.motion_m - turned / settings.motion_rad))
        return replace(self, places=(self.places - control[:2]) @ turned_back.T, left=left)
