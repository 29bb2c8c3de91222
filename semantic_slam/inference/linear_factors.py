"""Factors that are linearised here, and not by GTSAM: no callback, but true near those states only."""

from collections.abc import Mapping, Sequence
from functools import cache, lru_cache
from typing import Any

import gtsam
import numpy as np
from numpy.typing import NDArray

from semantic_slam.inference.manifold import Manifold

Array = NDArray[np.float64]

DESCRIPTOR = "e"
"""Symbol of E(n), below those of objects and robots."""
_SYMBOL_BITS = 56
"""Of a key, before its letter."""
_DESCRIPTOR_CODE = ord(DESCRIPTOR)
_jacobian_factor: Any = gtsam.JacobianFactor  # of one to three keys, which its type does not say


def letter_of(key: int) -> str:
    """The letter of a GTSAM key."""
    return chr(key >> _SYMBOL_BITS)


def is_descriptor(key: int) -> bool:
    """Whether a GTSAM key is some E(n)."""
    return key >> _SYMBOL_BITS == _DESCRIPTOR_CODE


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
    for own, blocks, right, point in zip(keys, zip(*jacobians, strict=True), -residual, points, strict=True):
        terms = [part for pair in zip(own, blocks, strict=True) for part in pair]
        factors.append(gtsam.LinearContainerFactor(_jacobian_factor(*terms, right, noise), point))
    return factors


def linearisation_points(manifold: Manifold, states: Sequence[Mapping[int, Array]]) -> list[gtsam.Values]:
    """GTSAM's values of each set of states, (d,) of a pose and (L,) of a descriptor.

    As steps from the origin: GTSAM tries a dozen types for a pose that is inserted.
    """
    poses = [state for own in states for key, state in own.items() if not is_descriptor(key)]
    tangents = iter(manifold.local(np.zeros(manifold.dimension), np.array(poses)) if poses else ())
    points = []
    for own in states:
        step = gtsam.VectorValues()
        for key, state in own.items():
            step.insert(key, state if is_descriptor(key) else next(tangents))
        points.append(_origin(manifold, tuple((key, len(state)) for key, state in own.items())).retract(step))
    return points


@lru_cache(maxsize=1024)
def _origin(manifold: Manifold, sizes: tuple[tuple[int, int], ...]) -> gtsam.Values:
    """Of variables by key and size."""
    values = gtsam.Values()
    for key, size in sizes:
        if is_descriptor(key):
            values.insert(key, np.zeros(size))
        else:
            manifold.insert(values, key, np.zeros(size))
    return values
