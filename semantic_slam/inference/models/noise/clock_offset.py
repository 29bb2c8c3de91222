"""Clock offset of odometry: how its motion changes with the offset between its stamps and the detections' stamps.

With an offset tau [s], the odometry stamped t + tau belongs to detections at t. A keyframe carries its motion at a few
offsets; each hypothesis fits a line about its current estimate of tau, and treats the nonlinearity as noise
(statistical linearisation: Arasaratnam, Haykin 2009, weights by a Gaussian at points of a uniform grid).
"""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array

OFFSETS = np.linspace(-2.0, 2.0, 9)
"""(G,) offsets at which motions are given, in prior standard deviations of the offset; 0 is the middle one."""
LEAST_SIGMA = float(OFFSETS[1] - OFFSETS[0])
"""Least standard deviation of the weights: a line through fewer than three points would ignore the nonlinearity."""


@dataclass(frozen=True, kw_only=True)
class OffsetLine:
    """A planar motion as a function of the offset c, in standard deviations of its prior: u Exp(slope c + w)."""

    control: Array  # u (3,)
    slope: Array  # (3,)
    covariance: Array  # (3, 3) of w, the deviation from the line


def shifts_of(controls: Array) -> Array:
    """(G, 3) differences of planar motions ``controls`` (G, 3) at all offsets from that at 0, in its tangent space."""
    plain = controls[len(OFFSETS) // 2]
    return np.asarray(se2.log(se2.between(np.broadcast_to(plain, controls.shape), controls)))


def line_at(control: Array, shifts: Array, mean: float, sigma: float) -> OffsetLine:
    """The line through ``control`` (3,) with ``shifts`` (G, 3), for an offset with ``mean`` and ``sigma``."""
    distance = (OFFSETS - np.clip(mean, OFFSETS[0], OFFSETS[-1])) / max(sigma, LEAST_SIGMA)
    weights = np.exp(-0.5 * distance**2)
    weights /= weights.sum()
    design = np.stack([np.ones(len(OFFSETS)), OFFSETS], axis=1)
    intercept, slope = np.linalg.solve((design.T * weights) @ design, (design.T * weights) @ shifts)
    off = shifts - design @ np.stack([intercept, slope])
    return OffsetLine(
        control=np.asarray(se2.compose(control, se2.exp(intercept))),
        slope=np.asarray(se2.right_jacobian(intercept) @ slope),
        covariance=(off.T * weights) @ off,
    )
