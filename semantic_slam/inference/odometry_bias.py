"""What odometry gets wrong all the way: a turn for every metre driven, and the length of a metre.

x_k = x_{k-1} u_k Exp(G_k c + w_k) with one unknown c ~ N(0, I) for the whole drive, in units of its prior's standard
deviations: a variable of the smoother like any other, so that a revisit tells of it, and it of the next revisit.
"""

from typing import Any

import gtsam
import numpy as np
from numpy.typing import NDArray

from semantic_slam.configuration import OdometryConfiguration
from semantic_slam.geometry import se2
from semantic_slam.inference.planar_factors import unit_noise

Array = NDArray[np.float64]

BIAS_LETTER = "c"
BIAS_KEY = int(gtsam.symbol(BIAS_LETTER, 0))


def bias_sigmas(settings: OdometryConfiguration) -> Array:
    """(2,) prior standard deviations of heading per metre [rad/m] and relative length; none where nothing is asked."""
    if not settings.estimate_bias:
        return np.zeros(0)
    return np.array([settings.sigma_bias_rad_per_m, settings.sigma_bias_scale])


def slopes(control: Array) -> Array:
    """(..., 3, 2) change of a planar ``control`` (..., 3), in its tangent space, by heading per metre and by length.

    The motion is taken as one arc: of twist t, on which the bias adds (0, 0, t_x) and (t_x, t_y, 0).
    """
    twist = se2.log(control)
    change = np.zeros((*twist.shape, 2))
    change[..., 2, 0] = twist[..., 0]
    change[..., :2, 1] = twist[..., :2]
    return np.asarray(se2.right_jacobian(twist) @ change)


def composed_slopes(before: Array, control: Array) -> Array:
    """(3, 2) of a motion with ``before`` that goes on with ``control``."""
    return np.asarray(se2.adjoint(se2.inverse(control)) @ before + slopes(control))


def bias_prior(size: int) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
    """N(0, I) of c, as a graph and its first values."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.add(gtsam.PriorFactorVector(BIAS_KEY, np.zeros(size), gtsam.noiseModel.Unit.Create(size)))
    values.insert(BIAS_KEY, np.zeros(size))
    return graph, values


def biased_factor(keys: tuple[int, int], control: Array, covariance: Array, by_bias: Array) -> Any:
    """Between two planar poses and c: GTSAM's own factor of the two, less what c makes of the control."""
    noise = gtsam.noiseModel.Gaussian.Covariance(covariance)
    plain = gtsam.BetweenFactorPose2(*keys, gtsam.Pose2(*control), noise)
    whitened = noise.R() @ by_bias
    negative = np.asfortranarray(-whitened)

    def error(this: Any, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
        bias = whitened @ values.atVector(BIAS_KEY)
        if jacobians is None:
            return np.asarray(plain.whitenedError(values) - bias)
        jacobian, negated = plain.linearize(values).jacobian()
        jacobians[0], jacobians[1], jacobians[2] = jacobian[:, :3], jacobian[:, 3:], negative
        return np.asarray(-negated - bias)

    return gtsam.CustomFactor(unit_noise(3), [*keys, BIAS_KEY], error)
