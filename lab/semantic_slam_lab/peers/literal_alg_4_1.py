"""PROPWEIGHTS of Alg. 4.1 as it is printed: a loop over the samples of one candidate, one draw at a time."""

import math
from collections.abc import Sequence

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam_lab.grid.world import World

Pose = tuple[float, float, float]


class LiteralWeights:
    """Weight update of a parent with the predicted robot Gaussian ``robot`` (mean, covariance)."""

    def __init__(self, world: World, robot: tuple[Array, Array], random: np.random.Generator, num_samples: int):
        self.world, self.robot, self.random, self.num_samples = world, robot, random, num_samples
        k = world.sensor.concentration
        upper = np.array([[k, -0.5 * k], [0.0, k]])
        self.information = upper.T @ upper
        self.log_normaliser = math.log(k * k) - 2.0 * math.log(2.0 * math.pi)
        self.log_normaliser -= 0.5 * math.log(world.noise.geometry[0] * world.noise.geometry[1])

    def weight(self, objects: Sequence[int], classes: Sequence[int]) -> float:
        """psi of one assignment and class realisation, times the prior of these classes."""
        mean = np.zeros(3 + 3 * len(objects))
        covariance = np.diag([0.0, 0.0, 0.0, *(list(self.world.noise.objects) * len(objects))])
        covariance[:3, :3] = self.robot[1]
        total = 0.0
        for _ in range(self.num_samples):
            tangent = self.random.multivariate_normal(mean, covariance)
            total += self._likelihood(tangent, objects, classes)
        return total / self.num_samples * 0.5 ** len(classes)

    def _likelihood(self, tangent: Array, objects: Sequence[int], classes: Sequence[int]) -> float:
        x = _moved(self.robot[0], tangent[:3])
        value = 1.0
        for i, (number, assigned) in enumerate(zip(objects, classes, strict=True)):
            o = _moved(self.world.object_means[number], tangent[3 + 3 * i : 6 + 3 * i])
            value *= self._density(i, x, o, assigned)
        return value

    def _density(self, detection: int, x: Pose, o: Pose, assigned: int) -> float:
        sensor, frame, noise = self.world.sensor, self.world.frames[0], self.world.noise
        distance = math.hypot(o[0] - x[0], o[1] - x[1])
        bearing = _wrapped(math.atan2(o[1] - x[1], o[0] - x[0]) - x[2])
        if distance > sensor.max_range_m or abs(bearing) > 0.5 * sensor.field_of_view_rad:
            return 0.0
        difference = distance - frame.geometry[detection, 0]
        turn = _wrapped(bearing - frame.geometry[detection, 1])
        squared = difference**2 / noise.geometry[0] + turn**2 / noise.geometry[1]
        azimuth = math.atan2(x[1] - o[1], x[0] - o[0]) - o[2]
        first = sensor.alpha * math.sin(0.5 * azimuth) ** 2 + 1.0 - sensor.alpha
        mean = (first, 1.0 - first) if assigned == 0 else (1.0 - first, first)
        residual = frame.features[detection] - np.array(mean)
        squared += residual @ self.information @ residual
        return math.exp(self.log_normaliser - 0.5 * squared)


def _moved(mean: Array, tangent: Array) -> Pose:
    """Pose times Exp(tangent)."""
    u, v, a = tangent
    sine, cosine = (math.sin(a) / a, (1.0 - math.cos(a)) / a) if abs(a) > 1e-9 else (1.0, 0.5 * a)
    x, y = sine * u - cosine * v, cosine * u + sine * v
    c, s = math.cos(mean[2]), math.sin(mean[2])
    return mean[0] + c * x - s * y, mean[1] + s * x + c * y, mean[2] + a


def _wrapped(angle: float) -> float:
    return math.remainder(angle, 2.0 * math.pi)
