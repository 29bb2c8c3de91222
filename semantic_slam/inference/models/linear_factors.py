"""Factors that are linearised here, and not by GTSAM: no callback, but true near those states only."""

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
    """GTSAM's model of whitened residuals."""
    return gtsam.noiseModel.Unit.Create(size)


def linear_factors(
    keys: Sequence[tuple[int, ...]], jacobians: Sequence[Array], residual: Array, points: Sequence[gtsam.Values]
) -> list[Any]:
    """One factor for each of B rows: (m,) keys, m Jacobians (B, F, size), (B, F) whitened residual, and where they are.

    ``points`` hold the variables of the row's factor, and may hold others.
    """
    noise = unit_noise(residual.shape[1])
    factors = []
    for variables, blocks, right, point in zip(keys, zip(*jacobians, strict=True), -residual, points, strict=True):
        terms = [part for pair in zip(variables, blocks, strict=True) for part in pair]
        factors.append(gtsam.LinearContainerFactor(_jacobian_factor(*terms, right, noise), point))
    return factors


def linearised(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> gtsam.NonlinearFactorGraph:
    """A graph's factors, each linearised at ``values``, in the same order.

    iSAM2 would hand a copy of all of its values to each callback into Python.
    """
    return gtsam.LinearContainerFactor.ConvertLinearGraph(graph.linearize(values), values)


def linearisation_points(
    spaces: Spaces, keys: Sequence[Sequence[tuple[int, ...]]], states: Array
) -> list[gtsam.Values]:
    """GTSAM's values for each set of factors, by the variables of its factors: a robot, an object, a descriptor if any.

    ``states`` (B, s + s + L) of the variables of all B factors; in one set a variable is at one place. As steps from
    one state: GTSAM tries a dozen types for a pose that is inserted. That state is turned, for GTSAM's exponential
    loses digits where a turn is next to none, as it would be from a heading of 0 to one that is nearly so.
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
