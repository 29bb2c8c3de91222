"""Robot and objects of one hypothesis before the detections of a keyframe."""

from dataclasses import dataclass

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.states.in_view import InViewRecord


@dataclass(frozen=True, kw_only=True)
class PredictedObjects:
    """Predicted robot and N objects of one parent; covariances in the tangent spaces at the means."""

    robot: Array  # (s,)
    robot_covariance: Array  # (r, r)
    objects: Array  # (N, s)
    gain: Array  # (N, l, r) regression Cov(o, x) Cov(x)^-1 of each object on the robot
    remainder: Array  # (N, l, l) covariance of the object given the robot
    in_view: InViewRecord  # after the keyframe before, under each distinct setting of the detection model
    robot_before: Array  # (s,) robot of the keyframe before, in the frame of the present one
    motion_noise: Array  # (r, r) covariance of the motion since then
