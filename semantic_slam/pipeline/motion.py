"""The robot's motion between two instants, from its odometry."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.configuration import OdometryConfiguration
from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import covariance_from_planar, planar_from_pose_vector
from semantic_slam.geometry.transform import between, interpolate, rotation_angle
from semantic_slam.inference.inputs.keyframe import OdometrySample
from semantic_slam.inference.models.clock_offset import shifts_of
from semantic_slam.inference.models.odometry_bias import slopes
from semantic_slam.inference.models.odometry_noise import odometry_covariance


@dataclass(frozen=True)
class OdometryPoint:
    """Where the odometry stands at one instant."""

    stamp_ns: int
    pose: Array  # (7,) T_odom_body
    travelled_m: float  # length of the path since the first sample
    turned_rad: float  # sum of all turns since the first sample
    slopes: Array | None = None  # (3, 3) sum of those of all steps, in the tangent space of odom; None: not asked for

    def advance(self, sample: OdometrySample) -> "OdometryPoint":
        """The point at the next sample."""
        step = between(self.pose, sample.pose)
        travelled = self.travelled_m + float(np.linalg.norm(step[:3]))
        turned = self.turned_rad + rotation_angle(step)
        return OdometryPoint(sample.stamp_ns, sample.pose, travelled, turned, self.slopes_at(sample.pose))

    def slopes_at(self, pose: Array) -> Array | None:
        """``slopes`` after one more step, an arc to ``pose``."""
        if self.slopes is None:
            return None
        before, after = planar_from_pose_vector(self.pose), planar_from_pose_vector(pose)
        return np.asarray(self.slopes + se2.adjoint(after) @ slopes(se2.between(before, after)))


def start(sample: OdometrySample, *, with_slopes: bool = False) -> OdometryPoint:
    """The point at the first sample; ``with_slopes``: how biases of the odometry change the motion is kept, too."""
    return OdometryPoint(sample.stamp_ns, sample.pose, 0.0, 0.0, np.zeros((3, 3)) if with_slopes else None)


def point_between(first: OdometryPoint, second: OdometryPoint, stamp_ns: int) -> OdometryPoint:
    """The point at an instant between two neighbours: steady motion."""
    share = (stamp_ns - first.stamp_ns) / (second.stamp_ns - first.stamp_ns)
    pose = interpolate(first.pose, second.pose, share)
    return OdometryPoint(
        stamp_ns,
        pose,
        (1.0 - share) * first.travelled_m + share * second.travelled_m,
        (1.0 - share) * first.turned_rad + share * second.turned_rad,
        first.slopes_at(pose),
    )


def motion_slopes(first: OdometryPoint, second: OdometryPoint) -> Array | None:
    """(3, 3) change of the planar motion between two points, in its tangent space, by the odometry's biases.

    Composed over all samples between, as :func:`odometry_bias.composed_slopes` does step by step: each step's slopes
    are moved to the motion's end, over all that the robot drove since.
    """
    if first.slopes is None or second.slopes is None:
        return None
    return np.asarray(se2.inverse_adjoint(planar_from_pose_vector(second.pose)) @ (second.slopes - first.slopes))


def motion_shifts(first: Array, second: Array) -> Array:
    """(G, 3) change of the planar motion by offsets of odometry's clock: ``clock_offset.shifts_of``.

    Between the odometry's poses ``first`` and ``second`` (G, 7), at all offsets of each.
    """
    controls = [planar_from_pose_vector(between(*pair)) for pair in zip(first, second, strict=True)]
    return shifts_of(np.array(controls))


def motion_covariance(first: OdometryPoint, second: OdometryPoint, noise: OdometryConfiguration) -> Array:
    """(6, 6) covariance of the motion between two points, over x y z rx ry rz at the second; planar."""
    travelled, turned = second.travelled_m - first.travelled_m, second.turned_rad - first.turned_rad
    return covariance_from_planar(odometry_covariance(travelled, turned, noise))
