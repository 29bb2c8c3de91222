"""Entropies of a mixture in nats: over its components, and over the association marginal (Eq. 4.8)."""

from collections.abc import Hashable, Sequence

import numpy as np
from numpy.typing import NDArray


def component_entropy(weights: NDArray[np.float64]) -> float:
    """-sum w ln w over the (H,) normalised weights; a weight of zero adds nothing."""
    positive = np.asarray(weights, dtype=np.float64)
    positive = positive[positive > 0.0]
    return float(max(0.0, -np.sum(positive * np.log(positive))))


def association_entropy(weights: NDArray[np.float64], association_keys: Sequence[Hashable]) -> float:
    """Entropy in nats over distinct association histories; components that differ only in classes or modes are summed.

    ``association_keys`` holds one key per weight, equal exactly when the association histories are.
    """
    marginal: dict[Hashable, float] = {}
    for key, weight in zip(association_keys, np.asarray(weights, dtype=np.float64), strict=True):
        marginal[key] = marginal.get(key, 0.0) + float(weight)
    return component_entropy(np.array(list(marginal.values())))
