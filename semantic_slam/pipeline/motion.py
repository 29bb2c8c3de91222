"""The robot's motion between two instants, from its odometry."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.configuration import OdometryConfiguration
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import covariance_from_planar
from semantic_slam.geometry.transform import between, interpolate, rotation_angle
from semantic_slam.inference.keyframe import OdometrySample


@dataclass(frozen=True)
class OdometryPoint:
    """Where the odometry stands at one instant."""

    stamp_ns: int
    pose: Array  # (7,) T_odom_body
    travelled_m: float  # length of the path since the first sample
    turned_rad: float  # sum of all turns since the first sample

    def advance(self, sample: OdometrySample) -> "OdometryPoint":
        """The point at the next sample."""
        step = between(self.pose, sample.pose)
        travelled = self.travelled_m + float(np.linalg.norm(step[:3]))
        return OdometryPoint(sample.stamp_ns, sample.pose, travelled, self.turned_rad + rotation_angle(step))


def start(sample: OdometrySample) -> OdometryPoint:
    """The point at the first sample."""
    return OdometryPoint(sample.stamp_ns, sample.pose, 0.0, 0.0)


def point_between(first: OdometryPoint, second: OdometryPoint, stamp_ns: int) -> OdometryPoint:
    """The point at an instant between two neighbours: steady motion."""
    share = (stamp_ns - first.stamp_ns) / (second.stamp_ns - first.stamp_ns)
    return OdometryPoint(
        stamp_ns,
        interpolate(first.pose, second.pose, share),
        (1.0 - share) * first.travelled_m + share * second.travelled_m,
        (1.0 - share) * first.turned_rad + share * second.turned_rad,
    )


def motion_covariance(first: OdometryPoint, second: OdometryPoint, noise: OdometryConfiguration) -> Array:
    """(6, 6) covariance of the motion between two points, over x y z rx ry rz at the second; planar.

    The variances of independent causes add: floor, path length and turning.
    """
    travelled, turned = second.travelled_m - first.travelled_m, second.turned_rad - first.turned_rad
    translation = noise.sigma_translation_floor_m**2 + (noise.sigma_translation_per_m * travelled) ** 2
    rotation = (
        noise.sigma_rotation_floor_rad**2
        + (noise.sigma_rotation_per_m * travelled) ** 2
        + (noise.sigma_rotation_per_rad * turned) ** 2
    )
    return covariance_from_planar(np.diag([translation, translation, rotation]))
