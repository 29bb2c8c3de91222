"""Global localisation: the initial pose ("start") of a lost robot is part of a history, like its noise setting.

A single linearisation does not hold over metres and all headings. Until the robot is localised in the map it maps in a
local frame, where the weight of its detections does not depend on where that frame lies; a history that associates
detections with objects of the map begins at a point c of a lattice over the initial poses. There a narrow Gaussian
N(c, D), the stand-in, replaces the wide prior p(x0), and its peak density is divided out again:

    P(Z) = int p(x0) L(x0) dx0 ~ p(c) / N(c; c, D) int N(x0; c, D) L(x0) dx0

The log weight comes out too small by half the mean squared distance of the posterior of x0 from c, in units of D: by
0.05 where the posterior is a third as wide as the stand-in and c is the nearest point.
"""

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.inference.states.gaussian import GaussianPrior

LOST_SIGMA_M, LOST_SIGMA_RAD = 1.0, 0.3
"""Standard deviations of the initial pose above which the robot counts as lost (global localisation)."""
STAND_IN_SIGMAS = np.array([0.5, 0.5, 0.15])
"""Stand-in's x, y [m], yaw [rad]: wide beside a fix by a few mapped objects, narrow enough to linearise in."""
OWN_FRAME_SIGMAS = np.array([0.01, 0.01, 0.01])
"""Standard deviations x, y [m], yaw [rad] of the initial pose in the local frame of a robot that is not localised."""
SPACING = 0.5
"""Distance between neighbouring lattice points, in standard deviations of the stand-in."""
REACH = 6.0
"""Extent of the lattice about the mean, in standard deviations of the initial pose."""

ANYWHERE = 0
"""Start number of a robot that is not localised in the map; lattice points have the numbers from 1 on."""


@dataclass(frozen=True)
class Starts:
    """Initial poses of a lost robot: a Gaussian along the axes of map with wrapped heading, and a lattice over it."""

    mean: Array  # (3,)
    covariance: Array  # (3, 3)

    @classmethod
    def of(cls, robot: GaussianPrior) -> "Starts | None":
        """The starts for a prior of the initial pose; None if it is narrow enough that the robot is not lost."""
        covariance = se2.rotate_covariance(robot.mean, robot.covariance)
        position, heading = float(np.linalg.eigvalsh(covariance[:2, :2])[-1]), float(covariance[2, 2])
        if position <= LOST_SIGMA_M**2 and heading <= LOST_SIGMA_RAD**2:
            return None
        return cls(robot.mean, covariance)

    @property
    def own_frame(self) -> GaussianPrior:
        """Prior of the initial pose in the local frame, while the robot is not localised."""
        return GaussianPrior(self.mean, np.diag(OWN_FRAME_SIGMAS**2))

    def number(self, pose: Array) -> int | None:
        """Number of the lattice point nearest to a pose (3,) in map; None beyond the lattice."""
        offset = np.append(pose[:2] - self.mean[:2], wrap_angle(pose[2] - self.mean[2]))
        at = np.round(offset / self._spacing).astype(int)
        if (np.abs(at) > self._half)[: 2 if self._is_circular else 3].any():
            return None
        place = (at + self._half) % self._counts
        return 1 + int(np.ravel_multi_index(tuple(place), tuple(self._counts)))

    def nearest(self, pose: Array, taken: Collection[int]) -> int | None:
        """Start for a pose (3,) in map: one of ``taken`` within a lattice spacing, else the nearest; None: beyond.

        Reusing a taken start keeps the same history from beginning at two neighbouring points.
        """
        for number in sorted(set(taken) - {ANYWHERE}):
            offset = self.pose(number) - pose
            offset[2] = wrap_angle(offset[2])
            if (np.abs(offset) <= self._spacing).all():
                return number
        return self.number(pose)

    def pose(self, number: int) -> Array:
        """(3,) pose in map of a start other than ANYWHERE."""
        at = np.array(np.unravel_index(number - 1, tuple(self._counts))) - self._half
        return se2.wrapped(self.mean + at * self._spacing)

    def prior(self, number: int) -> GaussianPrior:
        """The stand-in Gaussian that replaces the prior of the initial pose; in the local frame for ANYWHERE."""
        return GaussianPrior(self.pose(number), np.diag(self._sigmas**2)) if number != ANYWHERE else self.own_frame

    def log_weight(self, number: int) -> float:
        """Log of p(c) / N(c; c, D), the prior weight of a start; 0 for ANYWHERE."""
        if number == ANYWHERE:
            return 0.0
        log_peak = -1.5 * float(np.log(2.0 * np.pi)) - float(np.log(self._sigmas).sum())
        return float(self.log_density(self.pose(number))) - log_peak

    def log_density(self, poses: Array) -> Array:
        """(...,) log prior density of poses (..., 3) in map, per square metre and radian."""
        offset = poses - self.mean
        most = int(np.ceil(REACH * np.sqrt(self.covariance[2, 2]) / (2.0 * np.pi)))
        turns = 2.0 * np.pi * np.arange(-most, most + 1)
        offset = np.repeat(offset[..., None, :], len(turns), axis=-2)
        offset[..., 2] = wrap_angle(offset[..., 2]) + turns
        squared = (offset @ np.linalg.inv(self.covariance) * offset).sum(axis=-1)
        log_peak = -0.5 * float(np.linalg.slogdet(2.0 * np.pi * self.covariance)[1])
        return np.asarray(np.logaddexp.reduce(log_peak - 0.5 * squared, axis=-1))

    def in_map(self, states: Array, covariances: Array) -> tuple[Array, Array]:
        """Transform states in the local frame to map: (n, 3) poses and (n, 3, 3) covariances along its axes.

        Moments of mean + R(turn) (state - mean) + shift, over turn and shift of the prior.
        """
        arm = states[:, :2] - self.mean[:2]
        variance = float(self.covariance[2, 2])
        shrink, double = np.exp(-0.5 * variance), np.exp(-2.0 * variance)
        second = arm[:, :, None] * arm[:, None] + covariances[:, :2, :2]
        across = np.stack([-arm[:, 1], arm[:, 0]], axis=1)
        trace = np.trace(second, axis1=1, axis2=2)[:, None, None] * np.eye(2)
        turned = 0.5 * (1.0 + double) * second + 0.5 * (1.0 - double) * (trace - second)
        found = np.zeros_like(covariances)
        swung = shrink * across[:, :, None] * self.covariance[:2, 2]
        found[:, :2, :2] = turned - shrink**2 * arm[:, :, None] * arm[:, None] + self.covariance[:2, :2]
        found[:, :2, :2] += swung + np.swapaxes(swung, 1, 2)
        found[:, 2, 2] = covariances[:, 2, 2] + variance
        cross = shrink * (covariances[:, :2, 2] + variance * across) + self.covariance[:2, 2]
        found[:, :2, 2] = found[:, 2, :2] = cross
        mean = states.copy()
        mean[:, :2] = self.mean[:2] + shrink * arm
        return mean, found

    @cached_property
    def _sigmas(self) -> Array:
        """(3,) standard deviations of the stand-in, not above those of the prior."""
        return np.asarray(np.minimum(STAND_IN_SIGMAS, np.sqrt(np.diagonal(self.covariance))))

    @cached_property
    def _counts(self) -> Index:
        """(3,) number of lattice points along x, y and yaw."""
        sigmas = np.sqrt(np.diagonal(self.covariance))
        half = np.ceil(REACH * sigmas / (SPACING * self._sigmas))
        half[sigmas <= STAND_IN_SIGMAS] = 0  # the prior itself
        counts = 2 * half + 1
        if self._is_circular:
            counts[2] = 2 * np.ceil(np.pi / (SPACING * self._sigmas[2]))
        return np.asarray(counts, dtype=int)

    @cached_property
    def _is_circular(self) -> bool:
        """Whether the lattice covers all headings; their number is then even, so that each has its opposite."""
        return bool(REACH * self.covariance[2, 2] ** 0.5 >= np.pi)

    @property
    def _half(self) -> Index:
        return self._counts // 2

    @cached_property
    def _spacing(self) -> Array:
        """(3,) lattice spacing in metres and radians; if all headings are covered, they are evenly spaced."""
        spacing = SPACING * self._sigmas
        if self._is_circular:
            spacing[2] = 2.0 * np.pi / self._counts[2]
        return spacing
