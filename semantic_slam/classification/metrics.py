"""Quality metrics of class posteriors, computed from their logarithms (Eqs. 3.44-3.46)."""

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags


def msde(log_posteriors: Array, true_class: int) -> Array:
    """(..., C) log posteriors to (...,) mean squared detection errors: the Brier score over C (Eq. 3.44)."""
    truth = np.arange(log_posteriors.shape[-1]) == true_class
    return np.asarray(np.square(truth - np.exp(log_posteriors)).mean(axis=-1))


def log_mgr(log_posteriors: Array, true_class: int) -> Array:
    """(..., C) to (...,) natural log of the most likely class's probability over the true one's (Eq. 3.45)."""
    return np.asarray(log_posteriors.max(axis=-1) - log_posteriors[..., true_class])


def correct(log_posteriors: Array, true_class: int) -> Flags:
    """(..., C) to (...,) whether the true class is the most likely one; its mean is Eq. 3.46."""
    return np.asarray(log_posteriors.argmax(axis=-1) == true_class)
