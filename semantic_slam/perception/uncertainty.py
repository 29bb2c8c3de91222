"""Scalar measures of what a cloud of class probabilities does not know."""

import numpy as np

from semantic_slam.geometry.arrays import Array


def entropy(probabilities: Array) -> Array:
    """(..., C) distributions to (...,) entropies in nats, with 0 log 0 = 0."""
    logs = np.log(np.where(probabilities > 0.0, probabilities, 1.0))
    return np.asarray(-np.sum(probabilities * logs, axis=-1))


def predictive_entropy(samples: Array) -> Array:
    """(..., T, C) dropout samples to the entropy of their mean: all of the uncertainty, in nats."""
    return entropy(samples.mean(axis=-2))


def mutual_information(samples: Array) -> Array:
    """(..., T, C) dropout samples to the part that the model itself is uncertain of, in nats.

    Predictive entropy minus the mean entropy of the passes; never negative (Jensen), rounding removed.
    """
    return np.asarray(np.maximum(predictive_entropy(samples) - entropy(samples).mean(axis=-1), 0.0))


def sample_covariance(samples: Array) -> Array:
    """(..., T, F) to (..., F, F), unbiased; zero for one sample, which says nothing about a spread."""
    count, size = samples.shape[-2:]
    if count < 2:
        return np.zeros((*samples.shape[:-2], size, size))
    centred = samples - samples.mean(axis=-2, keepdims=True)
    return np.asarray(np.swapaxes(centred, -1, -2) @ centred / (count - 1))
