"""Poses of objects in the plane, whose headings do not bend the errors of their positions."""

from dataclasses import dataclass
from typing import Any

import gtsam
import numpy as np

from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.states.kinds.planar_poses import PlanarPoses

ANYWHERE_M = 1e7
"""Standard deviation of a position of which a prior of the heading alone says nothing."""


@dataclass(frozen=True)
class PlanarObjects(PlanarPoses):
    """Planar poses in the chart R^2 x S^1: a tangent vector (v, w) moves a position by R v and turns a heading by w.

    A robot errs along arcs, and SE(2)'s exponential map is the chart of its errors (:class:`PlanarPoses`). An object
    stays where it is however it faces: in that chart, a heading that nobody knows would bend the errors of a position
    that is well known, and what is not measured would change weights, places and covariances.
    """

    def retract(self, state: Array, tangent: Array) -> Array:
        return se2.compose(state, tangent)

    def local(self, state: Array, other: Array) -> Array:
        return se2.between(state, other)

    def exp(self, tangent: Array) -> Array:
        return se2.wrapped(tangent)

    def exp_and_jacobian(self, tangent: Array) -> tuple[Array, Array]:
        return tangent, _turned_back(tangent[..., 2])

    def moments(self, states: Array, covariances: Array) -> Array:
        return self.covariances(states, covariances)

    def prior_factors(self, key: int, mean: Array, covariance: Array) -> list[Any]:
        """Priors of position and heading apart; where they are correlated, one in SE(2)'s chart, as GTSAM has it."""
        if covariance[:2, 2].any():
            return super().prior_factors(key, mean, covariance)
        along_map = se2.rotate_covariance(mean, covariance)[:2, :2]
        position = gtsam.noiseModel.Gaussian.Covariance(along_map)
        heading = gtsam.noiseModel.Diagonal.Sigmas(np.array([ANYWHERE_M, ANYWHERE_M, np.sqrt(covariance[2, 2])]))
        pose = gtsam.Pose2(*mean)
        return [gtsam.PoseTranslationPrior2D(key, pose, position), gtsam.PriorFactorPose2(key, pose, heading)]


@dataclass(frozen=True)
class PosesAmongObjects(PlanarPoses):
    """Arithmetic over (..., N, 3) planar poses: objects in the rows from 1 up to ``end`` (None: all), else robots.

    All rows are computed at once, those of objects then in their own chart: gathering rows by kind takes twice as long.
    """

    end: int | None = None

    def retract(self, state: Array, tangent: Array) -> Array:
        return se2.compose(state, self.exp(tangent))

    def local(self, state: Array, other: Array) -> Array:
        relative = se2.between(state, other)
        found = se2.log(relative)
        found[..., 1 : self.end, :] = relative[..., 1 : self.end, :]
        return found

    def exp(self, tangent: Array) -> Array:
        found = se2.exp(tangent)
        found[..., 1 : self.end, :2] = tangent[..., 1 : self.end, :2]
        return found

    def exp_and_jacobian(self, tangent: Array) -> tuple[Array, Array]:
        found, chart = se2.exp_and_jacobian(tangent)
        found[..., 1 : self.end, :2] = tangent[..., 1 : self.end, :2]
        chart[..., 1 : self.end, :, :] = _turned_back(tangent[..., 1 : self.end, 2])
        return found, chart


def _turned_back(angles: Array) -> Array:
    """(..., 3, 3) slopes of R^2 x S^1 at turns (...): a later step is along axes that the turn has moved."""
    sine, cosine = se2.sine_cosine(angles)
    slopes = np.zeros((*np.shape(angles), 3, 3))
    slopes[..., 0, 0] = slopes[..., 1, 1] = cosine
    slopes[..., 0, 1], slopes[..., 1, 0] = sine, -sine
    slopes[..., 2, 2] = 1.0
    return slopes
