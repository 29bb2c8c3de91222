"""Where a run begins: as topic initialpose says, or the configuration, and roll and pitch as an IMU feels them."""

import numpy as np

from semantic_slam.configuration import Configuration
from semantic_slam.geometry import so3
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.building import initial_pose_of
from semantic_slam.inference.inputs.keyframe import Keyframe
from semantic_slam.messages.standard import PoseEstimate
from semantic_slam.pipeline.gravity.imu_use import unused_because

ANY_TILT_RAD = 0.5
"""Standard deviation of roll and pitch before the look that tells them."""
TILT = [3, 4]
"""Rows of roll and pitch, about the axes of map."""


def start_of(configuration: Configuration, told: PoseEstimate | None, first: Keyframe) -> tuple[Array, Array]:
    """Pose (7,) and covariance (6, 6) before the motion of the first keyframe. Raises InputError.

    What is ``told`` by topic initialpose is taken as it is. Without that a look at gravity in the first keyframe says
    how the body was tilted; it counts once, so before it nothing is known of that.
    """
    if told is not None:
        return told.pose, told.covariance
    pose, covariance = initial_pose_of(configuration)
    if first.level is None or unused_because(configuration):
        return pose, covariance
    tilted = so3.upright(so3.rotated(first.odometry[3:], first.level[:3]))
    ahead = so3.matrix(pose[3:])[:, 0]
    yaw = so3.exp(np.array([0.0, 0.0, np.arctan2(ahead[1], ahead[0])]))
    wide = covariance.copy()
    wide[TILT] = wide[:, TILT] = 0.0
    wide[TILT, TILT] = ANY_TILT_RAD**2
    return np.append(pose[:3], so3.product(yaw, tilted)), wide
