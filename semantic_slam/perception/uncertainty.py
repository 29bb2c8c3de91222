"""Scalar uncertainty measures of class-probability samples."""

import numpy as np

from semantic_slam.geometry.arrays import Array


def entropy(probabilities: Array) -> Array:
    """(..., C) distributions to (...,) entropies in nats, with 0 log 0 = 0."""
    logs = np.log(np.where(probabilities > 0.0, probabilities, 1.0))
    return np.asarray(-np.sum(probabilities * logs, axis=-1))


def predictive_entropy(samples: Array) -> Array:
    """Predictive entropy [nats] of (..., T, C) dropout samples: entropy of their mean, the total uncertainty."""
    return entropy(samples.mean(axis=-2))


def mutual_information(samples: Array) -> Array:
    """Mutual information [nats] of (..., T, C) dropout samples: the model (epistemic) part of the uncertainty.

    Predictive entropy minus the mean entropy of the passes; never negative (Jensen), rounding removed.
    """
    return np.asarray(np.maximum(predictive_entropy(samples) - entropy(samples).mean(axis=-1), 0.0))


def sample_covariance(samples: Array) -> Array:
    """(..., F, F) unbiased covariance of (..., T, F) samples; zero for a single sample."""
    count, size = samples.shape[-2:]
    if count < 2:
        return np.zeros((*samples.shape[:-2], size, size))
    centred = samples - samples.mean(axis=-2, keepdims=True)
    return np.asarray(np.swapaxes(centred, -1, -2) @ centred / (count - 1))
