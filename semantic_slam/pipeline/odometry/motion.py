"""The robot's motion between two instants, from its odometry."""

from dataclasses import dataclass, replace

import numpy as np

from semantic_slam.configuration import OdometryConfiguration
from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import covariance_from_planar, planar_from_pose_vector
from semantic_slam.geometry.transform import between, interpolate, rotation_angle
from semantic_slam.inference.inputs.keyframe import OdometrySample
from semantic_slam.inference.models.noise.clock_offset import shifts_of
from semantic_slam.inference.models.noise.odometry_noise import odometry_covariance, odometry_variances
from semantic_slam.inference.models.odometry_bias import slopes
from semantic_slam.messages.standard import NANOSECONDS
from semantic_slam.pipeline.odometry.odometry_rate import NOT_KNOWN, Rate
from semantic_slam.pipeline.odometry.stated_covariance import increment, since_start

NO_MOTION_VARIANCE = 1e-8
"""Square metres and radians, of a motion that is none: covariances have inverses."""


@dataclass(frozen=True)
class OdometryPoint:
    """Where the odometry stands at one instant."""

    stamp_ns: int
    pose: Array  # (7,) T_odom_body
    travelled_m: float  # length of the path since the first sample
    turned_rad: float  # sum of all turns since the first sample
    slopes: Array | None = None  # (3, 3) sum of those of all steps, in the tangent space of odom; None: not asked for
    rate: Rate = NOT_KNOWN  # of the samples up to this one
    sigma_m: float = 0.0  # standard deviation of x and of y beyond the odometry's own: it was missing then
    sigma_rad: float = 0.0  # of yaw, likewise
    covariance: Array | None = None  # (6, 6) x y z rx ry rz along the axes of odom, since its start; None: not stated

    def advance(self, sample: OdometrySample) -> "OdometryPoint":
        """The point at the next sample."""
        step = between(self.pose, sample.pose)
        travelled = self.travelled_m + float(np.linalg.norm(step[:3]))
        turned = self.turned_rad + rotation_angle(step)
        slopes_there = self.slopes_at(sample.pose)
        return OdometryPoint(
            sample.stamp_ns, sample.pose, travelled, turned, slopes_there, covariance=sample.covariance
        )

    def standing_until(self, stamp_ns: int) -> "OdometryPoint":
        """The point at a later instant of which there is no odometry any more: the robot may have moved on."""
        late_s = (stamp_ns - self.stamp_ns) / NANOSECONDS
        sigma_m, sigma_rad = self.rate.pace_m_s * late_s, self.rate.pace_rad_s * late_s
        return replace(self, stamp_ns=stamp_ns, sigma_m=sigma_m, sigma_rad=sigma_rad)

    def slopes_at(self, pose: Array) -> Array | None:
        """``slopes`` after one more step, an arc to ``pose``."""
        if self.slopes is None:
            return None
        before, after = planar_from_pose_vector(self.pose), planar_from_pose_vector(pose)
        return np.asarray(self.slopes + se2.adjoint(after) @ slopes(se2.between(before, after)))


def start(sample: OdometrySample, *, with_slopes: bool = False) -> OdometryPoint:
    """The point at the first sample; ``with_slopes``: how biases of the odometry change the motion is kept, too."""
    slopes_there = np.zeros((3, 3)) if with_slopes else None
    return OdometryPoint(sample.stamp_ns, sample.pose, 0.0, 0.0, slopes_there, covariance=sample.covariance)


def point_between(first: OdometryPoint, second: OdometryPoint, stamp_ns: int) -> OdometryPoint:
    """The point at an instant between two neighbours: steady motion, which within a gap is but the best guess."""
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
    )


def driven_between(first: OdometryPoint, second: OdometryPoint, stamp_ns: int) -> tuple[float, float]:
    """Length of the path [m] and sum of all turns [rad] at an instant between two neighbours."""
    share = (stamp_ns - first.stamp_ns) / (second.stamp_ns - first.stamp_ns)
    return (
        (1.0 - share) * first.travelled_m + share * second.travelled_m,
        (1.0 - share) * first.turned_rad + share * second.turned_rad,
    )


def _gap_sigmas(first: OdometryPoint, second: OdometryPoint, share: float) -> tuple[float, float]:
    """Standard deviations [m], [rad] at a share of the way between two samples; 0 where they are as close as usual."""
    step_s = (second.stamp_ns - first.stamp_ns) / NANOSECONDS
    if not first.rate.is_gap(step_s):
        return 0.0, 0.0
    from_end_s = min(share, 1.0 - share) * step_s
    pace_m_s = max(first.rate.pace_m_s, (second.travelled_m - first.travelled_m) / step_s)
    pace_rad_s = max(first.rate.pace_rad_s, (second.turned_rad - first.turned_rad) / step_s)
    return pace_m_s * from_end_s, pace_rad_s * from_end_s


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


def motion_covariance_in_space(first: OdometryPoint, second: OdometryPoint, noise: OdometryConfiguration) -> Array:
    """:func:`motion_covariance` of all six: as the odometry states, else along and about every axis alike.

    From an instant to itself nothing moves, whatever the odometry is like.
    """
    if second.stamp_ns == first.stamp_ns:
        return NO_MOTION_VARIANCE * np.eye(6)
    stated = stated_motion(first, second)
    if stated is not None:
        more_place, more_turn = _missing(first, second)
        return stated + np.diag(np.repeat([more_place, more_turn], 3))
    travelled, turned = second.travelled_m - first.travelled_m, second.turned_rad - first.turned_rad
    place, turn = odometry_variances(travelled, turned, noise)
    more_place, more_turn = _missing(first, second)
    return np.diag(np.repeat([place + more_place, turn + more_turn], 3))


def motion_covariance(first: OdometryPoint, second: OdometryPoint, noise: OdometryConfiguration) -> Array:
    """(6, 6) covariance of the motion between two points, over x y z rx ry rz at the second; planar.

    What is not known of either point, where odometry was missing, adds to it as if the two were independent.
    """
    travelled, turned = second.travelled_m - first.travelled_m, second.turned_rad - first.turned_rad
    place, turn = _missing(first, second)
    return covariance_from_planar(odometry_covariance(travelled, turned, noise) + np.diag([place, place, turn]))


def stated_motion(first: OdometryPoint, second: OdometryPoint) -> Array | None:
    """(6, 6) over x y z rx ry rz at the second point, by how much what the odometry states grows; None where it states
    nothing, or no covariance. Of its own start it knows all, which is stated as nothing is.
    """
    if second.covariance is None:
        return None
    return increment(first.pose, _known(first.covariance), second.pose, second.covariance)


def stated_between(first: OdometryPoint, second: OdometryPoint, pose: Array, share: float) -> Array | None:
    """(6, 6) along the axes of odom at a share of the way between two points; None where it is not stated there."""
    motion = stated_motion(first, second)
    return None if motion is None else since_start(first.pose, _known(first.covariance), pose, share * motion)


def _known(covariance: Array | None) -> Array:
    return np.zeros((6, 6)) if covariance is None else covariance


def _missing(first: OdometryPoint, second: OdometryPoint) -> tuple[float, float]:
    """Variances [m^2, rad^2] of what is not known of either point, where odometry was missing."""
    length_m = float(np.linalg.norm(second.pose[:3] - first.pose[:3]))
    place = first.sigma_m**2 + second.sigma_m**2 + (first.sigma_rad * length_m) ** 2
    return place, first.sigma_rad**2 + second.sigma_rad**2
