"""PROPWEIGHTS of Alg. 4.1 with all samples at once: 1000 from the prior, as the thesis draws them.

Two forms: draws of its own for every association, as the algorithm is printed, or draws that all associations of a
parent share, which is the strongest form, for a detection's density then is computed once per object.
"""

import itertools

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry import se2
from semantic_slam.geometry.arrays import Array
from semantic_slam_lab.grid.world import World

NUM_SAMPLES = 1000
"""Number of samples of the prior that the thesis draws."""
NUM_CLASSES = 2

Gaussian = tuple[Array, Array]
"""(3,) mean and (3, 3) covariance of the predicted robot, in the tangent space at the mean."""


def candidates_of(num_detections: int, num_objects: int) -> tuple[NDArray[np.int_], NDArray[np.int_]]:
    """(B, n) objects and (B, n) classes of all candidates of a parent whose classes are all open.

    Classes run fastest, so that a reshape to (associations, -1) brings those of an association together.
    """
    pairs = [
        (objects, classes)
        for objects in itertools.permutations(range(num_objects), num_detections)
        for classes in itertools.product(range(NUM_CLASSES), repeat=num_detections)
    ]
    return np.array([pair[0] for pair in pairs]), np.array([pair[1] for pair in pairs])


def shared_weights(world: World, robot: Gaussian, random: np.random.Generator, num_samples: int = NUM_SAMPLES) -> Array:
    """(B,) psi of Eq. 4.20 times the classes' prior, every sample used by all candidates of the parent."""
    count, num_objects = len(world.frames[0].objects), len(world.object_means)
    objects, classes = candidates_of(count, num_objects)
    x = _drawn_robots(robot, num_samples, random)
    spread = random.standard_normal((num_samples, num_objects, 3)) * np.sqrt(world.noise.objects)
    o = se2.compose(world.object_means, se2.exp(spread))
    density = [_density(world, i, x[:, None], o).reshape(num_samples, -1).T for i in range(count)]  # (2 N, S)
    product = density[0][NUM_CLASSES * objects[:, 0] + classes[:, 0]]
    for i in range(1, count):
        product *= density[i][NUM_CLASSES * objects[:, i] + classes[:, i]]
    return np.asarray(product.mean(axis=1) / NUM_CLASSES**count)


def separate_weights(
    world: World, robot: Gaussian, random: np.random.Generator, num_samples: int = NUM_SAMPLES
) -> Array:
    """(B,) as :func:`shared_weights`, but every association draws samples of its own."""
    count, num_objects = len(world.frames[0].objects), len(world.object_means)
    objects, classes = candidates_of(count, num_objects)
    per_association = NUM_CLASSES**count
    chosen, combinations = objects[::per_association], classes[:per_association]  # (A, n), (C^n, n)
    x = _drawn_robots(robot, len(chosen) * num_samples, random).reshape(len(chosen), num_samples, 3)
    product = np.ones((len(chosen), num_samples, per_association))
    for i in range(count):
        spread = random.standard_normal((len(chosen), num_samples, 3)) * np.sqrt(world.noise.objects)
        o = se2.compose(world.object_means[chosen[:, i], None], se2.exp(spread))
        product *= _density(world, i, x, o)[:, :, combinations[:, i]]
    return np.asarray(product.mean(axis=1).ravel() / per_association)


def _drawn_robots(robot: Gaussian, count: int, random: np.random.Generator) -> Array:
    mean, covariance = robot
    return se2.compose(mean, se2.exp(random.standard_normal((count, 3)) @ np.linalg.cholesky(covariance).T))


def _density(world: World, detection: int, x: Array, o: Array) -> Array:
    """(..., C) P(z | x, o, c) 1[o in sight] of robots and objects (..., 3)."""
    sensor, frame = world.sensor, world.frames[0]
    dx, dy = o[..., 0] - x[..., 0], o[..., 1] - x[..., 1]
    distance = np.hypot(dx, dy)
    bearing = _wrapped(np.arctan2(dy, dx) - x[..., 2])
    turn = _wrapped(bearing - frame.geometry[detection, 1])
    variances = world.noise.geometry
    squared = (distance - frame.geometry[detection, 0]) ** 2 / variances[0] + turn**2 / variances[1]
    cosine = -(dx * np.cos(o[..., 2]) + dy * np.sin(o[..., 2])) / distance
    first = 0.5 * sensor.alpha * (1.0 - cosine) + 1.0 - sensor.alpha  # Eq. 4.22
    z, k = frame.features[detection], sensor.concentration
    squares = [squared + _semantic_square(z, first, k), squared + _semantic_square(z[::-1], first, k, swapped=True)]
    normaliser = k**2 / (2.0 * np.pi) ** 2 / np.sqrt(variances[0] * variances[1])
    seen = (distance <= sensor.max_range_m) & (np.abs(bearing) <= sensor.field_of_view_rad / 2.0)
    return np.asarray(normaliser * np.exp(-0.5 * np.stack(squares, axis=-1)) * seen[..., None])


def _semantic_square(z: Array, first: Array, concentration: float, *, swapped: bool = False) -> Array:
    """|R (z - h)|^2 with h = [first, 1 - first]; ``swapped``: the components of both are exchanged."""
    a, b = z[0] - first, z[1] - 1.0 + first
    if swapped:
        a, b = b, a
    return np.asarray(concentration**2 * ((a - 0.5 * b) ** 2 + b**2))


def _wrapped(angle: Array) -> Array:
    return np.asarray(np.remainder(angle + np.pi, 2.0 * np.pi) - np.pi)
