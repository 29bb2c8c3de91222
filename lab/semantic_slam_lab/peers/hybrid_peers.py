"""GTSAM's own hybrid inference on a grid world without classes: HybridSmoother and DCSAM, same data as ours.

Their options have to share keys, so an association cannot choose between landmark variables. The landmarks are taken
as known instead, which is the fast way (built-in factors on the robot alone); what is not known of them widens the
measurement's noise. Visibility cannot be said.
"""

import itertools
from typing import Protocol

import gtsam
import numpy as np

from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam_lab.grid.world import Frame, World

MARGINAL_THRESHOLD = 0.99
"""Probability from which on HybridSmoother fixes a discrete variable."""
MAX_LEAVES = 10


class HybridPeer(Protocol):
    """Estimates associations frame by frame."""

    def update(self, frame: Frame) -> None:
        """Take in one frame."""

    def associations(self) -> list[tuple[int, ...]]:
        """The best ones, frame by frame; raises RuntimeError where there is no estimate."""


class SmootherPeer:
    """HybridSmoother with at most ``MAX_LEAVES`` leaves."""

    def __init__(self, world: World):
        self._problem = _Problem(world)
        self._smoother = gtsam.HybridSmoother(MARGINAL_THRESHOLD)

    def update(self, frame: Frame) -> None:
        newest = None if not self._problem.counts else self._problem.newest(self._smoother.linearizationPoint())
        graph, values = self._problem.factors(frame, newest)
        initial = gtsam.Values(self._smoother.linearizationPoint())
        initial.insert(values)
        self._smoother.update(graph, initial, MAX_LEAVES)

    def associations(self) -> list[tuple[int, ...]]:
        return self._problem.read(self._smoother.optimize())


class DcsamPeer:
    """DCSAM: alternates between discrete and continuous variables, one estimate of each."""

    def __init__(self, world: World):
        self._problem = _Problem(world)
        self._solver = gtsam.DCSAM()

    def update(self, frame: Frame) -> None:
        estimate = self._solver.calculateEstimate().nonlinear() if self._problem.counts else None
        newest = None if estimate is None else self._problem.newest(estimate)
        graph, values = self._problem.factors(frame, newest)
        self._solver.update(graph, gtsam.HybridValues(self._problem.guess(values), values))

    def associations(self) -> list[tuple[int, ...]]:
        return self._problem.read(self._solver.calculateEstimate())


class _Problem:
    """The growing hybrid factor graph."""

    def __init__(self, world: World):
        self.world = world
        self.counts: list[int] = []
        self._process = gtsam.noiseModel.Diagonal.Variances(np.array(world.noise.motion))
        self._new: list[Frame] = []

    def newest(self, values: gtsam.Values) -> Array:
        """(3,) newest robot pose in an estimate."""
        pose = values.atPose2(_robot(len(self.counts)))
        return np.array([pose.x(), pose.y(), pose.theta()])

    def factors(self, frame: Frame, newest: Array | None) -> tuple[gtsam.HybridNonlinearFactorGraph, gtsam.Values]:
        """What the frame adds, and initial values of the new variables."""
        graph, values, k = gtsam.HybridNonlinearFactorGraph(), gtsam.Values(), len(self.counts) + 1
        if newest is None:
            newest = self.world.robot_mean
            prior = gtsam.noiseModel.Diagonal.Variances(np.array(self.world.noise.robot))
            graph.push_back(gtsam.PriorFactorPose2(_robot(0), gtsam.Pose2(*newest), prior))
            values.insert(_robot(0), gtsam.Pose2(*newest))
        control = gtsam.Pose2(*frame.control)
        graph.push_back(gtsam.BetweenFactorPose2(_robot(k - 1), _robot(k), control, self._process))
        values.insert(_robot(k), gtsam.Pose2(*se2.compose(newest, frame.control)))
        for i in range(len(frame.geometry)):
            graph.push_back(self._mixture(k, i, frame))
        self.counts.append(len(frame.geometry))
        self._new.append(frame)
        return graph, values

    def guess(self, values: gtsam.Values) -> gtsam.DiscreteValues:
        """The choice nearest to where the detections of the newest frame point."""
        k, frame, found = len(self.counts), self._new[-1], gtsam.DiscreteValues()
        pose = values.atPose2(_robot(k))
        rays = frame.geometry[:, :1] * np.stack([np.cos(frame.geometry[:, 1]), np.sin(frame.geometry[:, 1])], axis=-1)
        places = np.array([pose.transformFrom(ray) for ray in rays])
        objects = self.world.object_means[np.array(self._options(len(rays))), :2]
        found[_choice(k)] = int(np.argmin(((objects - places) ** 2).sum(axis=(1, 2))))
        return found

    def read(self, estimate: gtsam.HybridValues) -> list[tuple[int, ...]]:
        """Associations of all frames."""
        return [self._options(count)[estimate.atDiscrete(_choice(k + 1))] for k, count in enumerate(self.counts)]

    def _options(self, count: int) -> list[tuple[int, ...]]:
        """What a frame's discrete variable stands for."""
        return list(itertools.permutations(range(len(self.world.object_means)), count))

    def _mixture(self, k: int, i: int, frame: Frame) -> gtsam.HybridNonlinearFactor:
        distance, bearing = frame.geometry[i]
        along = np.array([np.cos(bearing), np.sin(bearing)])
        across = np.array([-along[1], along[0]])
        range_variance, bearing_variance = self.world.noise.geometry
        covariance = range_variance * np.outer(along, along)
        covariance += bearing_variance * distance**2 * np.outer(across, across)
        covariance += self.world.noise.objects[0] * np.eye(2)
        noise = gtsam.noiseModel.Gaussian.Covariance(covariance)
        known = [
            gtsam.KnownLandmarkFactorPose2(_robot(k), mean[:2], distance * along, noise)
            for mean in self.world.object_means
        ]
        options = [known[choice[i]] for choice in self._options(len(frame.geometry))]
        return gtsam.HybridNonlinearFactor((_choice(k), len(options)), options)


def _robot(k: int) -> int:
    return int(gtsam.symbol("x", k))


def _choice(k: int) -> int:
    return int(gtsam.symbol("b", k))
