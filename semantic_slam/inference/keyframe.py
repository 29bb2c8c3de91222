"""A keyframe: the odometry since the previous one and the measurements taken at it."""

from dataclasses import dataclass

from semantic_slam.geometry.arrays import Array
from semantic_slam.perception.measurement import SemanticMeasurements


@dataclass(frozen=True)
class OdometrySample:
    """Pose of the body in the odom frame at one instant."""

    stamp_ns: int
    pose: Array  # (7,) T_odom_body: x y z qx qy qz qw


@dataclass(frozen=True, kw_only=True)
class Keyframe:
    """Input of one step of the hybrid belief."""

    index: int  # 0, 1, 2, ... without a gap
    stamp_ns: int
    odometry: Array  # (7,) T_previous_current; from the first odometry sample for keyframe 0
    odometry_covariance: Array  # (6, 6) x y z rx ry rz, in the tangent space at the current pose
    measurements: SemanticMeasurements
    odometry_slopes: Array | None = None  # (3, 2) of the planar motion by its biases; None: the motion was one arc
