"""Gravity direction from odometry whose frame is level."""

import numpy as np

from semantic_slam.configuration import OdometryConfiguration
from semantic_slam.geometry import so3
from semantic_slam.geometry.arrays import Array
from semantic_slam.messages.standard import NANOSECONDS
from semantic_slam.pipeline.odometry.motion import OdometryPoint


def level_at(point: OdometryPoint, before: OdometryPoint | None, settings: OdometryConfiguration) -> Array | None:
    """(4,) ``Keyframe.level`` at a keyframe, after the one ``before``; None if odometry does not measure it."""
    if settings.sigma_level_rad <= 0.0 or point.sigma_rad > 0.0:  # the odometry was missing
        return None
    elapsed_s = np.inf if before is None else (point.stamp_ns - before.stamp_ns) / NANOSECONDS
    variance = repeated(settings.sigma_level_rad**2, elapsed_s, settings.level_repeats_s)
    return np.append(so3.matrix(point.told_pose[3:])[2], variance)


def repeated(variance: float, elapsed_s: float, repeats_s: float) -> float:
    """Variance of a gravity measurement, given the time since the previous one.

    Errors of a sensor mount or filter are correlated in time: n measurements within ``repeats_s`` get n times the
    variance, so that together they count as one. This is an approximation: over many times ``repeats_s`` even a
    constant error averages out.
    """
    return max(repeats_s / max(elapsed_s, 1.0 / NANOSECONDS), 1.0) * variance
