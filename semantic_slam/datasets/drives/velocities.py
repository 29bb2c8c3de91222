"""Poses from forward and angular velocities."""

import numpy as np

from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array


def integrated(times_s: Array, forward_m_s: Array, angular_rad_s: Array) -> Array:
    """(N, 3) planar poses at N times, from the origin; velocities hold until the next time, so that steps are arcs.

    The last velocities are not used. Turns are exact: a step is the exponential of (v, 0, w) times its duration.
    """
    steps = np.diff(times_s)
    tangents = np.zeros((len(steps), 3))
    tangents[:, 0], tangents[:, 2] = forward_m_s[:-1] * steps, angular_rad_s[:-1] * steps
    start = np.zeros((1, 3))
    return se2.wrapped(np.concatenate([start, se2.along(start[0], se2.exp(tangents))]))
