"""Robot and objects of one hypothesis before the detections of a keyframe."""

from dataclasses import dataclass

from semantic_slam.geometry.arrays import Array


@dataclass(frozen=True, kw_only=True)
class PredictedObjects:
    """Predicted robot and N objects of one parent; covariances in the tangent spaces at the means."""

    robot: Array  # (s,)
    robot_covariance: Array  # (r, r)
    objects: Array  # (N, s)
    gain: Array  # (N, l, r) regression Cov(o, x) Cov(x)^-1 of each object on the robot
    remainder: Array  # (N, l, l) covariance of the object given the robot
