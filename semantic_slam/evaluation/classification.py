"""Quality of class probabilities."""

import numpy as np
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Array

LEAST_PROBABILITY = 1e-12
"""Probabilities are clipped here before their logarithm is taken."""


def negative_log_likelihood(probabilities: Array, true_classes: NDArray[np.int_]) -> float:
    """Mean of -ln P(true class) in nats over (N, C) ``probabilities``; NaN when N = 0."""
    if not len(true_classes):
        return float("nan")
    true = probabilities[np.arange(len(true_classes)), true_classes]
    return float(np.abs(np.log(np.maximum(true, LEAST_PROBABILITY))).mean())


def expected_calibration_error(probabilities: Array, true_classes: NDArray[np.int_], bins: int = 15) -> float:
    """Mean of |accuracy - confidence| over equal bins of the top class's probability, weighted by their counts.

    ``probabilities`` is (N, C); a confidence on an edge belongs to the bin below it. NaN when N = 0.
    """
    if not len(true_classes):
        return float("nan")
    confidence = probabilities.max(axis=1)
    right = probabilities.argmax(axis=1) == true_classes
    bin_of = np.clip(np.ceil(confidence * bins).astype(int) - 1, 0, bins - 1)
    gaps = np.bincount(bin_of, weights=right - confidence, minlength=bins)
    return float(np.abs(gaps).sum() / len(true_classes))
