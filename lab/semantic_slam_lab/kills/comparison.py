"""How far the beliefs of two runs lie apart."""

from collections.abc import Sequence

import numpy as np

from semantic_slam.inference.belief import HybridBelief

TOLERANCE = 1e-9
"""Beliefs that are nearer than this are the same."""


def largest_difference(ours: Sequence[HybridBelief], theirs: Sequence[HybridBelief], besides: str = "") -> float:
    """Over all numbers of all beliefs, those of one field apart; infinite where they are not of the same keyframes,
    hypotheses and objects.
    """
    if [belief.keyframe for belief in ours] != [belief.keyframe for belief in theirs]:
        return np.inf
    return max((_difference(a, b, besides) for a, b in zip(ours, theirs, strict=True)), default=0.0)


def _difference(ours: HybridBelief, theirs: HybridBelief, besides: str) -> float:
    largest = 0.0
    for name, value in vars(theirs).items():
        if name == besides:
            continue
        other = getattr(ours, name)
        if isinstance(value, np.ndarray) and value.dtype.kind == "f":
            if value.shape != other.shape or not np.array_equal(np.isfinite(value), np.isfinite(other)):
                return np.inf
            known = np.isfinite(value)
            largest = max(largest, float(np.abs(value - other)[known].max(initial=0.0)))
        elif isinstance(value, float):
            is_same = value == other or (np.isnan(value) and np.isnan(other))
            largest = max(largest, 0.0 if is_same else float(abs(value - other)))
        elif not np.array_equal(value, other):
            return np.inf
    return largest
