"""Covariances of odometry and detections that came without any: as configured."""

from dataclasses import dataclass, field

import numpy as np

from semantic_slam.configuration import OdometryConfiguration, PerceptionConfiguration
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.inference.models.odometry_noise import odometry_covariance


@dataclass(frozen=True)
class ConfiguredNoise:
    """NaN stands for what is not told; what is told stays as it is."""

    odometry: OdometryConfiguration = field(default_factory=OdometryConfiguration)
    perception: PerceptionConfiguration = field(default_factory=PerceptionConfiguration)

    def of_motion(self, control: Array, covariance: Array) -> Array:
        """(3, 3) over x, y, yaw of a planar motion, which counts as straight where it is not told."""
        if not np.isnan(covariance).any():
            return covariance
        return odometry_covariance(float(np.hypot(*control[:2])), abs(float(wrap_angle(control[2]))), self.odometry)

    def of_detections(self, ranges_m: Array, covariances: Array) -> Array:
        """(D, 2, 2) of [range, bearing]; the range's stays NaN where there is no range."""
        untold = np.isnan(covariances[:, 1, 1])
        if not untold.any():
            return covariances
        filled = covariances.copy()
        filled[untold] = np.diag([0.0, self.perception.sigma_bearing_rad**2])
        by_distance = (self.perception.sigma_range_per_m * ranges_m[untold]) ** 2
        filled[untold, 0, 0] = self.perception.sigma_range_m**2 + by_distance
        filled[untold & np.isnan(ranges_m), 0, 0] = np.nan
        return filled
