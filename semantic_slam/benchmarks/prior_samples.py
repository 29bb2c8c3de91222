"""PROPWEIGHTS of Alg. 4.1 with all samples at once: drawn once per parent, shared by every association and class.

The strongest form of the thesis's sampler: densities of each detection for each object and class are computed once
per sample, an association only multiplies them.
"""

import itertools

import numpy as np
from numpy.typing import NDArray

from semantic_slam.benchmarks.grid_world import World
from semantic_slam.geometry import se2
from semantic_slam.viewpoint.model import Array, Viewpoints
from semantic_slam.viewpoint.parametric import ParametricModel

NUM_SAMPLES = 1000
"""Of the thesis."""


def candidates_of(num_detections: int, num_objects: int) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
    """(B, n) objects and (B, n) classes of all candidates of a parent whose classes are all open."""
    pairs = [
        (objects, classes)
        for objects in itertools.permutations(range(num_objects), num_detections)
        for classes in itertools.product(range(2), repeat=num_detections)
    ]
    return np.array([pair[0] for pair in pairs]), np.array([pair[1] for pair in pairs])


def sampled_weights(
    world: World,
    robot: tuple[Array, Array],
    objects: NDArray[np.int_],
    classes: NDArray[np.int_],
    random: np.random.Generator,
    num_samples: int = NUM_SAMPLES,
) -> Array:
    """(B,) psi of Eq. 4.20 times the classes' prior, for one parent with the Gaussian ``robot`` (mean, covariance)."""
    mean, covariance = robot
    count, num_objects = objects.shape[1], len(world.object_means)
    x = se2.compose(mean, se2.exp(random.standard_normal((num_samples, 3)) @ np.linalg.cholesky(covariance).T))
    spread = random.standard_normal((num_samples, num_objects, 3)) * np.sqrt(world.noise.objects)
    o = se2.compose(world.object_means, se2.exp(spread))
    density = _densities(world, x, o)  # (n, N * 2, S)
    product = density[0, 2 * objects[:, 0] + classes[:, 0]]
    for i in range(1, count):
        product *= density[i, 2 * objects[:, i] + classes[:, i]]
    return np.asarray(product.mean(axis=1) * 0.5**count)


def _densities(world: World, x: Array, o: Array) -> Array:
    """(n, N * 2, S) P(z_i | x, o_j, c) 1[o_j in sight]."""
    sensor, frame = world.sensor, world.frames[0]
    dx, dy = o[..., 0] - x[:, None, 0], o[..., 1] - x[:, None, 1]
    distance, direction = np.hypot(dx, dy), np.arctan2(dy, dx)
    bearing = _wrapped(direction - x[:, None, 2])
    azimuth = direction + np.pi - o[..., 2]
    seen = (distance <= sensor.max_range_m) & (np.abs(bearing) <= sensor.field_of_view_rad / 2.0)
    model = ParametricModel(sensor.alpha, sensor.concentration)
    zero = np.zeros(azimuth.size)
    means = [
        model.predict(np.full(azimuth.size, c), Viewpoints(azimuth.ravel(), zero, zero)).mean.reshape(*o.shape[:2], 2)
        for c in range(2)
    ]
    whiten = sensor.concentration * np.array([[1.0, -0.5], [0.0, 1.0]])
    geometry_variance = np.array(world.noise.geometry)
    normaliser = np.linalg.det(whiten) / (2.0 * np.pi) ** 2 / np.sqrt(geometry_variance.prod())
    density = np.empty((len(frame.objects), o.shape[1], 2, len(x)))
    for i, (z, feature) in enumerate(zip(frame.geometry, frame.features, strict=True)):
        squared = (distance - z[0]) ** 2 / geometry_variance[0] + _wrapped(bearing - z[1]) ** 2 / geometry_variance[1]
        for c in range(2):
            semantic = (((feature - means[c]) @ whiten.T) ** 2).sum(axis=-1)
            density[i, :, c] = np.where(seen, normaliser * np.exp(-0.5 * (squared + semantic)), 0.0).T
    return density.reshape(len(frame.objects), -1, len(x))


def _wrapped(angle: Array) -> Array:
    return np.asarray(np.remainder(angle + np.pi, 2.0 * np.pi) - np.pi)
