"""Configured covariances for odometry and detections that come without any."""

from dataclasses import dataclass, field

import numpy as np

from semantic_slam.configuration import OdometryConfiguration, PerceptionConfiguration
from semantic_slam.geometry import so3
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.inference.models.noise.odometry_noise import odometry_covariance, odometry_covariance_in_space
from semantic_slam.perception.range_noise import range_variances


@dataclass(frozen=True)
class ConfiguredNoise:
    """Fills in covariances that are NaN; given ones stay as they are."""

    odometry: OdometryConfiguration = field(default_factory=OdometryConfiguration)
    perception: PerceptionConfiguration = field(default_factory=PerceptionConfiguration)

    def of_motion(self, control: Array, covariance: Array) -> Array:
        """(3, 3) over x, y, yaw of a planar motion; taken as straight if its covariance is not given."""
        if not np.isnan(covariance).any():
            return covariance
        return odometry_covariance(float(np.hypot(*control[:2])), abs(float(wrap_angle(control[2]))), self.odometry)

    def of_motion_in_space(self, control: Array, covariance: Array) -> Array:
        """(6, 6) over x y z rx ry rz of a motion (7,), as configured if its covariance is not given."""
        if not np.isnan(covariance).any():
            return covariance
        travelled, turned = float(np.linalg.norm(control[:3])), float(np.linalg.norm(so3.log(control[3:])))
        return odometry_covariance_in_space(travelled, turned, self.odometry)

    def of_detection_in_space(self, range_m: float) -> Array:
        """(3, 3) of [range, off the ray], with the bearing's standard deviation in both directions off the ray."""
        by_ray = self.perception.sigma_bearing_rad**2
        return np.diag([float(range_variances(range_m, self.perception)), by_ray, by_ray])

    def of_detections(self, ranges_m: Array, covariances: Array) -> Array:
        """(D, 2, 2) of [range, bearing]; the range's stays NaN where there is no range."""
        untold = np.isnan(covariances[:, 1, 1])
        if not untold.any():
            return covariances
        filled = covariances.copy()
        filled[untold] = np.diag([0.0, self.perception.sigma_bearing_rad**2])
        filled[untold, 0, 0] = range_variances(ranges_m[untold], self.perception)
        filled[untold & np.isnan(ranges_m), 0, 0] = np.nan
        return filled
