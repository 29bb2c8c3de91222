"""What odometry states of its own errors: a covariance since its start, which grows from pose to pose.

With S of the pose before, and the step T between the two, that of the pose after is Ad(T^-1) S Ad(T^-1)^T + Q: Q is the
motion's own. Where odometry states something else, the same numbers in every message or less and less, Q is none.
"""

import numpy as np

from semantic_slam.geometry import se3
from semantic_slam.geometry.arrays import Array

LEAST_VARIANCE = 1e-12
"""A micrometre, or a microradian: less is rounding."""
LARGEST_VARIANCE = 1e6
"""Beyond a kilometre nothing is known, and differences are rounding."""
ROUNDING = 1e-12
"""Share of the covariances since the start, by which their difference is wrong."""


def increment(before: Array, covariance_before: Array, after: Array, covariance_after: Array) -> Array | None:
    """(6, 6) of the motion between two poses (7,) over x y z rx ry rz at the second; None where it is none.

    The covariances of the poses are along the axes of their frame.
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
    """(6, 6) of the pose ``after`` along the axes of its frame, from that of the motion to it."""
    first, second = se3.wrapped(before), se3.wrapped(after)
    grown = _moved(first, covariance_before, second) + motion[se3.TO_MESSAGE][:, se3.TO_MESSAGE]
    return se3.covariance_along_parent(second, grown)


def _moved(before: Array, covariance_before: Array, after: Array) -> Array:
    """(6, 6) in the tangent space at the pose after, of what is not known before."""
    slopes = se3.inverse_adjoint(se3.between(before, after))
    return np.asarray(slopes @ se3.covariance_at_pose(before, covariance_before) @ slopes.T)
