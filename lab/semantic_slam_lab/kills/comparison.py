"""How far the beliefs of two runs lie apart."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from semantic_slam.inference.belief import HybridBelief

TOLERANCE = 1e-9
"""Beliefs that are nearer than this are the same."""


def largest_difference(ours: Sequence[HybridBelief], theirs: Sequence[HybridBelief], besides: str = "") -> float:
    """Over all numbers of all beliefs, those of one field apart.

    Infinite where they are not of the same keyframes, hypotheses and objects, where one run knows a number that the
    other one does not, and where there are no beliefs to compare.
    """
    if [belief.keyframe for belief in ours] != [belief.keyframe for belief in theirs]:
        return np.inf
    return max((_difference(a, b, besides) for a, b in zip(ours, theirs, strict=True)), default=np.inf)


def kept(difference: float) -> float | None:
    """A difference as JSON holds it: None where it is infinite."""
    return difference if np.isfinite(difference) else None


def _difference(ours: HybridBelief, theirs: HybridBelief, besides: str) -> float:
    largest = 0.0
    for name, value in vars(theirs).items():
        if name == besides:
            continue
        other = getattr(ours, name)
        if isinstance(value, float) or (isinstance(value, np.ndarray) and value.dtype.kind == "f"):
            largest = max(largest, _apart(other, value))
        elif not np.array_equal(value, other):
            return np.inf
    return largest


def _apart(ours: ArrayLike, theirs: ArrayLike) -> float:
    """Largest difference of numbers (...), of which NaN equals NaN alone; infinite where their shapes differ."""
    one, other = np.asarray(ours, dtype=float), np.asarray(theirs, dtype=float)
    if one.shape != other.shape:
        return np.inf
    differ = ~((one == other) | (np.isnan(one) & np.isnan(other)))
    distances = np.abs(one[differ] - other[differ])
    return float(np.where(np.isnan(distances), np.inf, distances).max(initial=0.0))
