"""The probability that objects are inside the sensor's region and not occluded, now and in the keyframe before.

Coordinates of the region (distance and angles) count as independent normals. From one keyframe to the next each of them
is renewed with the probability 1 - rho, rho being the correlation of both keyframes' coordinates. A robot at rest (rho
= 1) has the same objects inside; one that moves by more than the errors of their places has others.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.special import ndtr

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.inference.states.in_view import InViewProbabilities

LEAST_VARIANCE = 1e-12
"""Least variance of a direction [rad^2]."""
NOT_DETECTED = np.array(-1)
"""Number of the detection of a place where it has none."""


class Margins(NamedTuple):
    """Edges of the region in C coordinates of objects (...,), in standard deviations from each object."""

    lower: Array  # (C, ...)
    upper: Array  # (C, ...)
    slopes: Array  # (C, ..., d) Jacobians of the coordinates by the object's place, over their standard deviations

    @property
    def inside(self) -> Array:
        """(...,) probability of being inside."""
        return np.asarray(self.within.prod(axis=0))

    @property
    def within(self) -> Array:
        """(C, ...) probability of each coordinate to be between its edges."""
        return np.asarray(np.maximum(ndtr(self.upper) - ndtr(self.lower), 0.0))

    def shares(self, covariance: Array) -> Array:
        """(C, ...) variance of each coordinate by a (..., d, d) part of the covariance, over its whole variance."""
        return _products(self.slopes, covariance, self.slopes)


class Places(NamedTuple):
    """Positions (..., d) of objects in the frame of the sensor, which has moved since the keyframe before."""

    points: Array  # (..., d)
    covariance: Array  # (..., d, d)
    by_robot: Array  # (..., d, d) part of it that the error of the robot's pose adds
    by_motion: Array  # (..., d, d) covariance that the motion's noise adds
    turn: Array  # (d, d) axes of the sensor before, in the present frame
    shift: Array  # (d,) place of the sensor before, in the present frame

    def overlap(self, margins_of: Callable[[Array, Array], Margins]) -> tuple[InViewProbabilities, Array]:
        """Probabilities of being inside, and (C, ...) correlations of each coordinate with that before.

        ``margins_of`` gives the margins of places in the frame of the sensor, with their covariances.
        """
        points = np.stack([self.points, (self.points - self.shift) @ self.turn])
        both = margins_of(points, np.stack([self.covariance, self.turn.T @ self.covariance @ self.turn]))
        now, before = (Margins(*(part[:, number] for part in both)) for number in range(2))
        fresh = np.minimum(now.shares(self.by_motion), now.shares(self.by_robot))
        correlation = _products(before.slopes @ self.turn.T, self.covariance, now.slopes)
        lasting = np.clip(correlation * (1.0 - fresh), 0.0, 1.0)
        known = np.sqrt(np.maximum(1.0 - fresh, LEAST_VARIANCE))
        lower, upper = before.lower / known, before.upper / known
        within, then = now.within, np.maximum(ndtr(upper) - ndtr(lower), 0.0)
        common = ndtr(np.minimum(now.upper, upper)) - ndtr(np.maximum(now.lower, lower))
        apart = within * then
        both = apart + lasting * (np.maximum(common, 0.0) - apart)
        return InViewProbabilities(then.prod(axis=0), within.prod(axis=0), both.prod(axis=0)), lasting

    def at(self, rows: Index, columns: Index) -> "Places":
        """Some of the places of (K, N) objects."""
        at = rows, columns
        return self._replace(
            points=self.points[at],
            covariance=self.covariance[at],
            by_robot=self.by_robot[at],
            by_motion=self.by_motion[at],
        )

    def flat_with(self, others: "Places") -> "Places":
        """The (K, N) places as (K N,), then n ``others``."""
        return self._replace(
            points=_flat_with(self.points, others.points, 1),
            covariance=_flat_with(self.covariance, others.covariance, 2),
            by_robot=_flat_with(self.by_robot, others.by_robot, 2),
            by_motion=_flat_with(self.by_motion, others.by_motion, 2),
        )

    def measured(self, points: Array, slopes: Array) -> "Places":
        """Places at ``points`` (n, d), given a measurement of each, of unit covariance and (n, m, d) ``slopes`` by it.

        The robot's pose counts as given the measurements already. A Kalman update of the rest of the covariance.
        """
        rest = self.covariance - self.by_robot
        cross = rest @ np.swapaxes(slopes, -1, -2)
        gain = cross @ np.linalg.inv(slopes @ cross + np.eye(slopes.shape[-2]))
        left = np.eye(points.shape[-1]) - gain @ slopes
        turned = np.swapaxes(left, -1, -2)
        by_robot = left @ self.by_robot @ turned
        return self._replace(
            points=points,
            covariance=by_robot + left @ rest,
            by_robot=by_robot,
            by_motion=left @ self.by_motion @ turned,
        )

    def lasting_sight(self, variance: Array, of_shown: float) -> Array:
        """(...,) correlation with which the same objects are occluded as before.

        It decays with the change of the direction to an object, relative to the ``variance`` (...,) of that direction
        [rad^2], and with the variance ``of_shown`` of the directions of the occluders, which every keyframe draws anew.
        """
        then = self.points - self.shift
        lengths = np.linalg.norm(self.points, axis=-1) * np.linalg.norm(then, axis=-1)
        cosine = (self.points * then).sum(axis=-1) / np.maximum(lengths, LEAST_VARIANCE)
        own = np.maximum(variance, LEAST_VARIANCE)
        turned = np.arccos(np.clip(cosine, -1.0, 1.0))
        return np.asarray(np.exp(-0.5 * turned**2 / own) * own / (own + of_shown))


def with_occlusion(overlap: InViewProbabilities, before: Array, now: Array, lasting: Array) -> InViewProbabilities:
    """Probabilities to be inside and not occluded; ``before`` and ``now`` (...,): that nothing occludes an object.

    ``lasting`` (...,): correlation of both.
    """
    apart = before * now
    both = apart + lasting * (np.minimum(before, now) - apart)
    return InViewProbabilities(before=overlap.before * before, now=overlap.now * now, both=overlap.both * both)


def _flat_with(values: Array, others: Array, size: int) -> Array:
    """(K, N, ...) values as (K N, ...), then ``others`` (n, ...); ``size`` axes belong to each."""
    return np.concatenate([values.reshape(-1, *values.shape[-size:]), others])


def _products(left: Array, matrices: Array, right: Array) -> Array:
    """(C, ...) products of vectors (C, ..., d) with matrices (..., d, d) between them."""
    return np.asarray(((left[..., None, :] @ matrices)[..., 0, :] * right).sum(axis=-1))
