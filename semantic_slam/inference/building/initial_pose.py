"""Where the robot is before the first keyframe, as the configuration or a plain Python session states it."""

import numpy as np
from numpy.typing import ArrayLike

from semantic_slam.configuration import Configuration
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import covariance_from_planar, pose_vector_from_planar
from semantic_slam.inference.inputs.detection import positive_definite


def initial_pose_of(configuration: Configuration) -> tuple[Array, Array]:
    """Planar initial pose (7,) and covariance (6, 6) of the configuration."""
    mean, sigma = np.array(configuration.initial_pose.mean), np.array(configuration.initial_pose.sigma)
    x, y, yaw = mean
    pose = np.array([x, y, 0.0, 0.0, 0.0, np.sin(yaw / 2.0), np.cos(yaw / 2.0)])
    return pose, covariance_from_planar(np.diag(sigma**2))


def start_of_run(
    configuration: Configuration, pose: ArrayLike | None, covariance: ArrayLike | None
) -> tuple[Array, Array]:
    """(7,) pose and (6, 6) covariance in map; what is None is the configuration's. Raises InputError."""
    configured_pose, configured_covariance = initial_pose_of(configuration)
    return (
        configured_pose if pose is None else _pose_vector(pose),
        configured_covariance if covariance is None else _whole_covariance(covariance),
    )


def _pose_vector(values: ArrayLike) -> Array:
    """(7,) from itself, or from x, y [m] and yaw [rad]."""
    pose = np.asarray(values, dtype=np.float64)
    if pose.shape not in ((3,), (7,)) or not np.isfinite(pose).all():
        raise InputError("initial_pose: give x, y [m] and yaw [rad], or x y z qx qy qz qw, as finite numbers")
    return pose_vector_from_planar(pose) if len(pose) == 3 else pose


def _whole_covariance(values: ArrayLike) -> Array:
    """(6, 6) from itself, or from that of x, y and yaw."""
    planar = np.shape(values) != (6, 6)
    covariance = positive_definite(values, 3 if planar else 6, "initial_covariance")
    return covariance_from_planar(covariance) if planar else covariance
