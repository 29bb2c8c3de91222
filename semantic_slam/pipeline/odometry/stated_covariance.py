"""Covariance of a motion from the covariance that odometry states for its pose since the start.

With the covariance S of the pose before and the step T, that of the pose after is Ad(T^-1) S Ad(T^-1)^T + Q, where Q is
the covariance of the motion. If odometry states constant or decreasing numbers, Q is not a covariance.
"""

import numpy as np

from semantic_slam.geometry import se3
from semantic_slam.geometry.arrays import Array

LEAST_VARIANCE = 1e-12
"""Variance of a micrometre or a microradian; less is rounding error."""
LARGEST_VARIANCE = 1e6
"""Variance of a kilometre; beyond it the pose is unknown, and differences are rounding errors."""
ROUNDING = 1e-12
"""Relative rounding error of the difference of two covariances since the start."""


def increment(before: Array, covariance_before: Array, after: Array, covariance_after: Array) -> Array | None:
    """(6, 6) covariance of the motion between two poses (7,), over x y z rx ry rz at the second; None if it is none.

    The poses' covariances are along the axes of their parent frame.
    """
    if max(np.abs(covariance_before).max(), np.abs(covariance_after).max()) > LARGEST_VARIANCE:
        return None
    found = se3.covariance_at_pose(se3.wrapped(after), covariance_after)
    motion = found - _moved(se3.wrapped(before), covariance_before, se3.wrapped(after))
    motion = 0.5 * (motion + motion.T)
    if not np.linalg.eigvalsh(motion)[0] > LEAST_VARIANCE + ROUNDING * float(np.trace(found)):
        return None
    return np.asarray(motion[se3.TO_MESSAGE][:, se3.TO_MESSAGE])


def since_start(before: Array, covariance_before: Array, after: Array, motion: Array) -> Array:
    """(6, 6) covariance of the pose ``after`` along the axes of its parent frame, from that of the motion to it."""
    first, second = se3.wrapped(before), se3.wrapped(after)
    grown = _moved(first, covariance_before, second) + motion[se3.TO_MESSAGE][:, se3.TO_MESSAGE]
    return se3.covariance_along_parent(second, grown)


def _moved(before: Array, covariance_before: Array, after: Array) -> Array:
    """(6, 6) covariance of the pose before, transported into the tangent space at the pose after."""
    slopes = se3.inverse_adjoint(se3.between(before, after))
    return np.asarray(slopes @ se3.covariance_at_pose(before, covariance_before) @ slopes.T)
