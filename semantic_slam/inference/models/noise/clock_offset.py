"""Odometry whose stamps are not of the detections' clock: how its motion changes with the offset between the two.

With an offset tau [s], what odometry tells at t + tau belongs to detections at t. A keyframe carries its motion at a
few offsets; each hypothesis takes the line that suits what it knows of tau by now, and what bends is noise
(statistical linearisation: Arasaratnam, Haykin 2009, weights by a Gaussian at points of an even grid).
"""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array

OFFSETS = np.linspace(-2.0, 2.0, 9)
"""(G,) at which motions are told, in standard deviations of the prior of the offset; 0 lies in the middle."""
LEAST_SIGMA = float(OFFSETS[1] - OFFSETS[0])
"""Standard deviation of the weights at least: a line through fewer than three points leaves out how motions bend."""


@dataclass(frozen=True, kw_only=True)
class OffsetLine:
    """A planar motion as a function of the offset c, in standard deviations of its prior: u Exp(slope c + w)."""

    control: Array  # u (3,)
    slope: Array  # (3,)
    covariance: Array  # (3, 3) of w: what the line does not follow


def shifts_of(controls: Array) -> Array:
    """(G, 3) what planar motions ``controls`` (G, 3) at all offsets add to that without one, in its tangent space."""
    plain = controls[len(OFFSETS) // 2]
    return np.asarray(se2.log(se2.between(np.broadcast_to(plain, controls.shape), controls)))


def line_at(control: Array, shifts: Array, mean: float, sigma: float) -> OffsetLine:
    """The line through ``control`` (3,) with ``shifts`` (G, 3), for an offset of ``mean`` and ``sigma``."""
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
