"""Relative motion of the robot between two instants, from odometry."""

from dataclasses import dataclass, replace

import numpy as np

from semantic_slam.configuration import OdometryConfiguration
from semantic_slam.geometry import se2, se3
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import covariance_from_planar, planar_from_pose_vector
from semantic_slam.geometry.transform import between, compose, interpolate, inverse, rotation_angle
from semantic_slam.inference.inputs.keyframe import OdometrySample
from semantic_slam.inference.models.noise.clock_offset import shifts_of
from semantic_slam.inference.models.noise.odometry_noise import odometry_covariance, odometry_covariance_in_space
from semantic_slam.inference.models.odometry_bias import slopes
from semantic_slam.messages.standard import NANOSECONDS
from semantic_slam.pipeline.odometry.odometry_rate import NOT_KNOWN, Rate
from semantic_slam.pipeline.odometry.stated_covariance import increment, since_start

NO_MOTION_VARIANCE = 1e-8
"""Variance [m^2, rad^2] of a motion over zero time, which keeps covariances invertible."""


@dataclass(frozen=True)
class OdometryPoint:
    """State of the odometry at one instant; its path goes on after a jump as if the robot had stood meanwhile."""

    stamp_ns: int
    pose: Array  # (7,) T_path_body; the path's frame is odom's until the first jump
    travelled_m: float  # length of the path since the first sample
    turned_rad: float  # sum of absolute turns since the first sample
    slopes: Array | None = None  # (3, 3) sum of all steps' bias Jacobians, in odom's tangent space; None: not needed
    rate: Rate = NOT_KNOWN  # of the samples up to this one
    sigma_m: float = 0.0  # additional standard deviation of x and of y where odometry is missing
    sigma_rad: float = 0.0  # additional standard deviation of yaw where odometry is missing
    covariance: Array | None = None  # (6, 6) x y z rx ry rz along the path's axes, since its start; None: not stated
    T_path_odom: Array | None = None  # (7,); None: no jump so far
    lost_m: float = 0.0  # sum of the standard deviations of x and of y of all jumps since the first sample
    lost_rad: float = 0.0  # sum of those of yaw

    @property
    def told_pose(self) -> Array:
        """(7,) T_odom_body, as odometry tells it."""
        return self.pose if self.T_path_odom is None else compose(inverse(self.T_path_odom), self.pose)

    def jumps_to(self, sample: OdometrySample) -> bool:
        """Whether the step to the next sample is a jump."""
        step = between(self.pose, self._on_path(sample).pose)
        step_s = (sample.stamp_ns - self.stamp_ns) / NANOSECONDS
        return self.rate.is_jump(step_s, float(np.linalg.norm(step[:3])), rotation_angle(step))

    def advance(self, sample: OdometrySample) -> "OdometryPoint":
        """The point at the next sample."""
        there = self._on_path(sample)
        step = between(self.pose, there.pose)
        return replace(
            self,
            stamp_ns=there.stamp_ns,
            pose=there.pose,
            travelled_m=self.travelled_m + float(np.linalg.norm(step[:3])),
            turned_rad=self.turned_rad + rotation_angle(step),
            slopes=self.slopes_at(there.pose),
            covariance=there.covariance,
        )

    def after_jump_to(self, sample: OdometrySample) -> "OdometryPoint":
        """The point at the next sample, to which odometry jumps: where it was, but it may have moved at its pace."""
        step_s = (sample.stamp_ns - self.stamp_ns) / NANOSECONDS
        after = replace(
            self,
            stamp_ns=sample.stamp_ns,
            T_path_odom=compose(self.pose, inverse(sample.pose)),
            lost_m=self.lost_m + self.rate.pace_m_s * step_s,
            lost_rad=self.lost_rad + self.rate.pace_rad_s * step_s,
        )
        return replace(after, covariance=after._on_path(sample).covariance)

    def _on_path(self, sample: OdometrySample) -> OdometrySample:
        """The sample with its pose, and its covariance, in the path's frame."""
        if self.T_path_odom is None:
            return sample
        pose, covariance = compose(self.T_path_odom, sample.pose), sample.covariance
        if covariance is not None:
            at_body = se3.covariance_at_pose(se3.wrapped(sample.pose), covariance)
            covariance = se3.covariance_along_parent(se3.wrapped(pose), at_body)
        return replace(sample, pose=pose, covariance=covariance)

    def standing_until(self, stamp_ns: int) -> "OdometryPoint":
        """The point at an instant after the last odometry; its sigmas grow with time, as the robot may have moved."""
        late_s = (stamp_ns - self.stamp_ns) / NANOSECONDS
        sigma_m, sigma_rad = self.rate.pace_m_s * late_s, self.rate.pace_rad_s * late_s
        return replace(self, stamp_ns=stamp_ns, sigma_m=sigma_m, sigma_rad=sigma_rad)

    def slopes_at(self, pose: Array) -> Array | None:
        """``slopes`` after one more step, along an arc to ``pose``."""
        if self.slopes is None:
            return None
        before, after = planar_from_pose_vector(self.pose), planar_from_pose_vector(pose)
        return np.asarray(self.slopes + se2.adjoint(after) @ slopes(se2.between(before, after)))


def start(sample: OdometrySample, *, with_slopes: bool = False) -> OdometryPoint:
    """The point at the first sample; ``with_slopes``: also keep the Jacobians of the motion by odometry biases."""
    slopes_there = np.zeros((3, 3)) if with_slopes else None
    return OdometryPoint(sample.stamp_ns, sample.pose, 0.0, 0.0, slopes_there, covariance=sample.covariance)


def point_between(first: OdometryPoint, second: OdometryPoint, stamp_ns: int) -> OdometryPoint:
    """The point at an instant between two samples, by constant velocity; within a gap it gets additional sigmas."""
    share = (stamp_ns - first.stamp_ns) / (second.stamp_ns - first.stamp_ns)
    pose = interpolate(first.pose, second.pose, share)
    sigma_m, sigma_rad = _gap_sigmas(first, second, share)
    return OdometryPoint(
        stamp_ns,
        pose,
        *driven_between(first, second, stamp_ns),
        first.slopes_at(pose),
        first.rate,
        sigma_m,
        sigma_rad,
        stated_between(first, second, pose, share),
        first.T_path_odom,
        (1.0 - share) * first.lost_m + share * second.lost_m,
        (1.0 - share) * first.lost_rad + share * second.lost_rad,
    )


def driven_between(first: OdometryPoint, second: OdometryPoint, stamp_ns: int) -> tuple[float, float]:
    """Length of the path [m] and sum of all turns [rad] at an instant between two neighbours."""
    share = (stamp_ns - first.stamp_ns) / (second.stamp_ns - first.stamp_ns)
    return (
        (1.0 - share) * first.travelled_m + share * second.travelled_m,
        (1.0 - share) * first.turned_rad + share * second.turned_rad,
    )


def _gap_sigmas(first: OdometryPoint, second: OdometryPoint, share: float) -> tuple[float, float]:
    """Standard deviations [m], [rad] at a fraction of the way between two samples; 0 unless there is a gap."""
    step_s = (second.stamp_ns - first.stamp_ns) / NANOSECONDS
    if not first.rate.is_gap(step_s):
        return 0.0, 0.0
    from_end_s = min(share, 1.0 - share) * step_s
    pace_m_s = max(first.rate.pace_m_s, (second.travelled_m - first.travelled_m) / step_s)
    pace_rad_s = max(first.rate.pace_rad_s, (second.turned_rad - first.turned_rad) / step_s)
    return pace_m_s * from_end_s, pace_rad_s * from_end_s


def motion_slopes(first: OdometryPoint, second: OdometryPoint) -> Array | None:
    """(3, 3) Jacobian of the planar motion between two points by the odometry biases, in its tangent space.

    Composed over all samples between, equal to the step-by-step :func:`odometry_bias.composed_slopes`: each step's
    Jacobian is transported to the end of the motion.
    """
    if first.slopes is None or second.slopes is None:
        return None
    return np.asarray(se2.inverse_adjoint(planar_from_pose_vector(second.pose)) @ (second.slopes - first.slopes))


def motion_shifts(first: Array, second: Array) -> Array:
    """(G, 3) changes of the planar motion by offsets of the odometry clock, by ``clock_offset.shifts_of``.

    ``first`` and ``second`` are the odometry poses (G, 7) at the two instants, for all offsets.
    """
    controls = [planar_from_pose_vector(between(*pair)) for pair in zip(first, second, strict=True)]
    return shifts_of(np.array(controls))


def motion_covariance_in_space(first: OdometryPoint, second: OdometryPoint, noise: OdometryConfiguration) -> Array:
    """(6, 6) covariance of a 3D motion: as stated by odometry, else of the noise model.

    Over x y z rx ry rz at the second point. Between equal stamps it is :data:`NO_MOTION_VARIANCE` times the identity.
    """
    if second.stamp_ns == first.stamp_ns:
        return NO_MOTION_VARIANCE * np.eye(6)
    stated = stated_motion(first, second)
    if stated is not None:
        more_place, more_turn = _missing(first, second)
        return stated + np.diag(np.repeat([more_place, more_turn], 3))
    travelled, turned = second.travelled_m - first.travelled_m, second.turned_rad - first.turned_rad
    return odometry_covariance_in_space(travelled, turned, noise, _missing(first, second))


def motion_covariance(first: OdometryPoint, second: OdometryPoint, noise: OdometryConfiguration) -> Array:
    """(6, 6) covariance of the planar motion between two points, over x y z rx ry rz at the second.

    The additional variances of both points, where odometry was missing, and of jumps between them are added as if
    independent.
    """
    travelled, turned = second.travelled_m - first.travelled_m, second.turned_rad - first.turned_rad
    place, turn = _missing(first, second)
    return covariance_from_planar(odometry_covariance(travelled, turned, noise) + np.diag([place, place, turn]))


def stated_motion(first: OdometryPoint, second: OdometryPoint) -> Array | None:
    """(6, 6) growth of the covariance stated by odometry, over x y z rx ry rz at the second point.

    None if odometry states none at the second point, or if the difference is no covariance. If none is stated at the
    first point, it counts as zero there.
    """
    if second.covariance is None:
        return None
    return increment(first.pose, _known(first.covariance), second.pose, second.covariance)


def stated_between(first: OdometryPoint, second: OdometryPoint, pose: Array, share: float) -> Array | None:
    """(6, 6) stated covariance along the axes of odom, at a fraction of the way between two points; None if unknown."""
    motion = stated_motion(first, second)
    return None if motion is None else since_start(first.pose, _known(first.covariance), pose, share * motion)


def _known(covariance: Array | None) -> Array:
    return np.zeros((6, 6)) if covariance is None else covariance


def _missing(first: OdometryPoint, second: OdometryPoint) -> tuple[float, float]:
    """Additional variances [m^2, rad^2] of the motion between two points, where odometry was missing or jumped."""
    length_m = float(np.linalg.norm(second.pose[:3] - first.pose[:3]))
    lost_m, lost_rad = second.lost_m - first.lost_m, second.lost_rad - first.lost_rad
    place = first.sigma_m**2 + second.sigma_m**2 + (first.sigma_rad * length_m) ** 2
    turn = first.sigma_rad**2 + second.sigma_rad**2
    return place + lost_m**2 + (lost_rad * length_m) ** 2, turn + lost_rad**2
