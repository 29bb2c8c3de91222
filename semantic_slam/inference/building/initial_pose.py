"""The initial pose, before the first keyframe, from the configuration or from a Python session's arguments."""

import numpy as np
from numpy.typing import ArrayLike

from semantic_slam.configuration import Configuration
from semantic_slam.errors import InputError
from semantic_slam.foreign_numbers import as_numbers
from semantic_slam.geometry import se3, so3
from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.pose import covariance_from_planar, pose_vector_from_planar
from semantic_slam.inference.inputs.detection import positive_definite


def initial_pose_of(configuration: Configuration) -> tuple[Array, Array]:
    """Initial pose (7,) and covariance (6, 6) of the configuration. Raises InputError."""
    told, needed = configuration.initial_pose, 6 if configuration.is_spatial else 3
    for name, numbers in (("mean", told.mean), ("sigma", told.sigma)):
        if len(numbers) != needed:
            raise InputError(
                f"initial_pose.{name} has {len(numbers)} numbers; state_space: {configuration.state_space} needs"
                f" {needed}, {'x, y, z, roll, pitch and yaw' if needed == 6 else 'x, y and yaw'}"
            )
    mean, sigma = np.array(told.mean), np.array(told.sigma)
    if configuration.is_spatial:
        return np.concatenate([mean[:3], _turned(*mean[3:])]), np.diag(sigma**2)
    x, y, yaw = mean
    pose = np.array([x, y, 0.0, 0.0, 0.0, np.sin(yaw / 2.0), np.cos(yaw / 2.0)])
    return pose, covariance_from_planar(np.diag(sigma**2))


def start_of_run(
    configuration: Configuration, pose: ArrayLike | None, covariance: ArrayLike | None
) -> tuple[Array, Array]:
    """(7,) pose and (6, 6) covariance in map; None is replaced by the configuration's value. Raises InputError."""
    if pose is None or covariance is None:
        configured_pose, configured_covariance = initial_pose_of(configuration)
    return (
        configured_pose if pose is None else _pose_vector(pose, configuration),
        configured_covariance if covariance is None else _whole_covariance(covariance, configuration),
    )


def _pose_vector(values: ArrayLike, configuration: Configuration) -> Array:
    """(7,) from itself, or in the plane from x, y [m] and yaw [rad]. Raises InputError."""
    pose = as_numbers(values)
    if configuration.is_spatial and (pose.shape != (7,) or not np.isfinite(pose).all()):
        raise InputError("initial_pose: give x y z qx qy qz qw as finite numbers for state_space: spatial")
    if pose.shape not in ((3,), (7,)) or not np.isfinite(pose).all():
        raise InputError("initial_pose: give x, y [m] and yaw [rad], or x y z qx qy qz qw, as finite numbers")
    if len(pose) == 3:
        return pose_vector_from_planar(pose)
    if not se3.is_pose(pose):
        raise InputError("initial_pose: qx qy qz qw is no quaternion of unit length; normalise it")
    if not configuration.is_spatial and np.hypot(*pose[3:5]) > se3.NEARLY:
        raise InputError("initial_pose: has a roll or a pitch; give a turn about z alone, or set state_space: spatial")
    return pose


def _whole_covariance(values: ArrayLike, configuration: Configuration) -> Array:
    """(6, 6) from itself, or in the plane from that of x, y and yaw."""
    planar = np.shape(values) != (6, 6) and not configuration.is_spatial
    covariance = positive_definite(values, 3 if planar else 6, "initial_covariance")
    return covariance_from_planar(covariance) if planar else covariance


def _turned(roll: float, pitch: float, yaw: float) -> Array:
    """(4,) quaternion of turns about x, then y, then z of map (REP-103)."""
    turns = so3.exp(np.diag([roll, pitch, yaw]))
    return so3.product(turns[2], so3.product(turns[1], turns[0]))
