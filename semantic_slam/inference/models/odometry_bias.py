"""Odometry biases: turn per metre, scale of translation, scale of rotation, and clock offset.

x_k = x_{k-1} u_k Exp(G_k c + w_k), with an unknown c ~ N(0, I) in units of its prior standard deviations; the prior
mean is applied to u_k already. c follows a random walk from one stretch of the drive to the next, so every stretch has
its own variable in the smoother: a loop closure informs biases and poses alike, and what the biases say of the next one
is part of the belief. A single variable for the whole drive would be in every clique, and each change of it would
propagate through the whole Bayes tree. Unequal wheels turn the robot as it drives; wheels larger than nominal, or
mounted closer than nominal, scale up its translations and rotations (Borenstein, Feng 1996).
"""

from dataclasses import dataclass
from typing import Any

import gtsam
import numpy as np

from semantic_slam.configuration import OdometryConfiguration
from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.models.callback_factor import callback_factor
from semantic_slam.inference.states.keys import begins_stretch, bias_key

NAMES = ("odometry.bias_rad_per_m", "odometry.bias_scale", "odometry.bias_turn_scale", "odometry.clock_offset_s")
"""Components of c."""
CLOCK = 3
"""Index of the clock offset in c: see :mod:`clock_offset`."""
CHANGE = 0.1
"""Standard deviation of the change of c from one stretch to the next, in prior standard deviations."""


def bias_sigmas(settings: OdometryConfiguration) -> Array:
    """(4,) prior standard deviations: heading per metre [rad/m], relative length, relative turn, clock [s].

    Empty where biases are not estimated. A standard deviation of 0 removes that component from every motion.
    """
    if not settings.estimate_bias:
        return np.zeros(0)
    return np.array(
        [
            settings.sigma_bias_rad_per_m,
            settings.sigma_bias_scale,
            settings.sigma_bias_turn_scale,
            settings.sigma_clock_offset_s,
        ]
    )


def bias_means(settings: OdometryConfiguration) -> Array:
    """(4,) prior means, in the units of :func:`bias_sigmas`; empty where biases are not estimated."""
    if not settings.estimate_bias:
        return np.zeros(0)
    return np.array([settings.bias_rad_per_m, settings.bias_scale, settings.bias_turn_scale, settings.clock_offset_s])


def slopes(control: Array) -> Array:
    """(..., 3, 3) Jacobian of a planar ``control`` (..., 3), in its tangent space, by turn per metre, length and turn.

    The motion is taken as one arc, of twist t, to which the biases add (0, 0, t_x), (t_x, t_y, 0) and (0, 0, t_yaw).
    """
    twist = se2.log(control)
    change = np.zeros((*twist.shape, 3))
    change[..., 2, 0] = twist[..., 0]
    change[..., :2, 1] = twist[..., :2]
    change[..., 2, 2] = twist[..., 2]
    return np.asarray(se2.right_jacobian(twist) @ change)


def by_bias(slopes: Array, sigmas: Array) -> Array:
    """(3, 4) Jacobian of a planar motion by the components of c, from its ``slopes`` (3, 3); the clock's is 0."""
    return np.concatenate([slopes * sigmas[:CLOCK], np.zeros((3, 1))], axis=1)


def composed_slopes(before: Array, control: Array, own: Array) -> Array:
    """(3, 3) bias Jacobian of a motion (``before``) followed by ``control``, which has the Jacobian ``own``."""
    return np.asarray(se2.inverse_adjoint(control) @ before + own)


def bias_prior(size: int) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
    """Prior N(0, I) of the first bias variable, as a graph and its initial values."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.add(gtsam.PriorFactorVector(bias_key(-1), np.zeros(size), gtsam.noiseModel.Unit.Create(size)))
    values.insert(bias_key(-1), np.zeros(size))
    return graph, values


def bias_change(keyframe: int, bias: Array, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> None:
    """Add the bias variable of a stretch that begins at ``keyframe``; ``bias`` (p,): the estimate of the last one."""
    keys = bias_key(keyframe - 1), bias_key(keyframe)
    noise = gtsam.noiseModel.Isotropic.Sigma(len(bias), CHANGE)
    graph.add(gtsam.BetweenFactorVector(*keys, np.zeros(len(bias)), noise))
    values.insert(keys[1], bias)


def with_changed_bias(covariance: Array, keyframe: int, size: int) -> Array:
    """Covariance of a planar robot, ``size`` biases and all else, as the motion to ``keyframe`` begins.

    The biases' variance grows where a new stretch begins.
    """
    if not size or not begins_stretch(keyframe):
        return covariance
    wider, rows = covariance.copy(), 3 + np.arange(size)
    wider[rows, rows] += CHANGE**2
    return wider


@dataclass(frozen=True)
class BiasedMotion:
    """Odometry between two planar poses, and its Jacobian (3, p) by biases; keys of the poses and of the biases."""

    keys: tuple[int, int, int]
    control: Array  # (3,)
    covariance: Array  # (3, 3)
    by_bias: Array  # (3, p)


def biased_factor(keys: tuple[int, int, int], control: Array, covariance: Array, by_bias: Array) -> Any:
    """Factor of two planar poses and a bias c: GTSAM's between factor, corrected for the effect of c on the control."""
    noise = gtsam.noiseModel.Gaussian.Covariance(covariance)
    plain = gtsam.BetweenFactorPose2(*keys[:2], gtsam.Pose2(*control), noise)
    whitened = noise.R() @ by_bias
    negative = np.asfortranarray(-whitened)

    def error(this: Any, values: gtsam.Values, jacobians: list[Array] | None) -> Array:
        explained = whitened @ values.atVector(keys[2])
        if jacobians is None:
            return np.asarray(plain.whitenedError(values) - explained)
        jacobian, negated = plain.linearize(values).jacobian()
        jacobians[0], jacobians[1], jacobians[2] = jacobian[:, :3], jacobian[:, 3:], negative
        return np.asarray(-negated - explained)

    return callback_factor(BiasedMotion(keys, control, covariance, by_bias), keys, 3, error)
