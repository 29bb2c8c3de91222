"""Factors linearised here instead of by GTSAM: no callback, but valid near their linearisation points only."""

from collections.abc import Sequence
from functools import cache, lru_cache
from typing import Any

import gtsam
import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.states.keys import is_descriptor
from semantic_slam.inference.states.spaces import Spaces

_jacobian_factor: Any = gtsam.JacobianFactor  # of one to three keys, which its type does not say


@cache
def unit_noise(size: int) -> Any:
    """GTSAM's unit noise model, for whitened residuals."""
    return gtsam.noiseModel.Unit.Create(size)


def linear_factors(
    keys: Sequence[tuple[int, ...]], jacobians: Sequence[Array], residual: Array, points: Sequence[gtsam.Values]
) -> list[Any]:
    """One factor for each of B rows: keys (m,), m Jacobians (B, F, size), whitened residual (B, F), and its point.

    ``points`` hold the linearisation point of the row's variables, and may hold others.
    """
    noise = unit_noise(residual.shape[1])
    factors = []
    for variables, blocks, right, point in zip(keys, zip(*jacobians, strict=True), -residual, points, strict=True):
        terms = [part for pair in zip(variables, blocks, strict=True) for part in pair]
        factors.append(gtsam.LinearContainerFactor(_jacobian_factor(*terms, right, noise), point))
    return factors


def linearised(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> gtsam.NonlinearFactorGraph:
    """The factors of a graph, each linearised at ``values``, in the same order.

    iSAM2 would pass a copy of all its values to each callback into Python.
    """
    return gtsam.LinearContainerFactor.ConvertLinearGraph(graph.linearize(values), values)


def linearisation_points(
    spaces: Spaces, keys: Sequence[Sequence[tuple[int, ...]]], states: Array
) -> list[gtsam.Values]:
    """GTSAM values for each set of factors, over the variables of its factors: robots, objects, and descriptors if any.

    ``states`` (B, s + s + L) of the variables of all B factors; within one set a variable has one state. They are
    retracted from one origin, as GTSAM tries a dozen types for every pose inserted. That origin is rotated, because
    GTSAM's exponential map loses digits at tiny rotations, as from a heading of 0 to one that is nearly 0.
    """
    together = spaces.storage.size(1)
    robots, objects = spaces.steps(states[:, :together])
    rows = zip(robots, objects, states[:, together:], strict=True)
    points = []
    for factor_set in keys:
        step, known = gtsam.VectorValues(), dict[int, Array]()
        for variables in factor_set:
            known |= zip(variables, next(rows), strict=False)
        for key, value in known.items():
            step.insert(key, value)
        points.append(_origin(spaces, tuple(known), states.shape[1] - together).retract(step))
    return points


@lru_cache(maxsize=64)
def _origin(spaces: Spaces, keys: tuple[int, ...], descriptor_size: int) -> gtsam.Values:
    values = gtsam.Values()
    for key in keys:
        if is_descriptor(key):
            values.insert(key, np.zeros(descriptor_size))
        else:
            space = spaces.of(key)
            space.insert(values, key, space.origin)
    return values
