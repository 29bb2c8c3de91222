"""Odometry in all six made of known poses: their increments with noise, and what covariance that comes to."""

from itertools import pairwise

import numpy as np

from semantic_slam.datasets.drives.noisy_odometry import DRIFT, HEADING_DRIFT_RAD
from semantic_slam.datasets.space.path import SpatialPath
from semantic_slam.geometry import se3
from semantic_slam.geometry.arrays import Array


def noisy_odometry_in_space(path: SpatialPath, drift: float, rng: np.random.Generator) -> SpatialPath:
    """The path of a body as its odometry has it, from the origin: a random walk over the distance.

    The error of each step is white, in its tangent space, with a variance in proportion to the step's length: ``drift``
    along each axis and HEADING_DRIFT_RAD in proportion about each, after a metre. Covariances are those of the whole
    motion since the start, to first order.
    """
    turn = HEADING_DRIFT_RAD * drift / DRIFT
    per_root_metre = np.concatenate([np.full(3, turn), np.full(3, drift)])
    poses, covariances = [np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])], [np.zeros((6, 6))]
    spread = np.zeros((6, 6))  # in the tangent space at the pose
    for before, after in pairwise(path.poses):
        true = se3.between(before, after)
        sigmas = per_root_metre * np.sqrt(np.linalg.norm(true[:3]))
        step = se3.retract(true, sigmas * rng.standard_normal(6))
        spread = grown(spread, step, np.diag(sigmas**2))
        poses.append(se3.wrapped(se3.compose(poses[-1], step)))
        covariances.append(se3.covariance_along_parent(poses[-1], spread))
    return SpatialPath(path.stamps_ns, np.array(poses), np.array(covariances))


def grown(spread: Array, step: Array, noise: Array) -> Array:
    """(6, 6) of a pose after a step (7,) of it, in the tangent space there."""
    moved = se3.inverse_adjoint(step)
    return np.asarray(moved @ spread @ moved.T + noise)
