"""Weighted samples: how good they are, and what to put in the place of light ones."""

import numpy as np

from semantic_slam.classification.classifier import normalised
from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.log_space import log_sum_exp


def effective_size(log_weights: Array) -> float:
    """Number of evenly weighted samples that are as good as (P,) ones with these normalised log weights."""
    return float(np.exp(-log_sum_exp(2.0 * log_weights)))


def rejection_control(log_weights: Array, generator: np.random.Generator) -> tuple[Index, Array]:
    """Index of the samples to be replaced by fresh ones of the target, and then the log weights of all.

    A sample is kept with a chance of its weight over the mean one, and then has no less than the mean weight: that
    leaves the kept ones properly weighted. Kept and fresh ones are two estimates of the same average, and count by
    their effective sizes.
    """
    count = len(log_weights)
    weights = np.exp(log_weights) * count  # mean 1
    kept = generator.random(count) < weights
    lifted = np.log(np.maximum(weights, 1.0))
    fresh = np.flatnonzero(~kept)
    size = effective_size(normalised(lifted[kept])) if kept.any() else 0.0
    renewed = np.full(count, -np.log(size + len(fresh)))
    if kept.any():
        renewed[kept] = normalised(lifted[kept]) + np.log(size / (size + len(fresh)))
    return fresh, renewed


def systematic_resampling(log_weights: Array, generator: np.random.Generator) -> tuple[Index, Index]:
    """Samples to be lost, and for each the one to be copied in its place; all weigh the same afterwards."""
    count = len(log_weights)
    edges = np.cumsum(np.exp(log_weights)) * count
    points = np.arange(count) + generator.random()
    offspring = np.bincount(np.minimum(np.searchsorted(edges, points), count - 1), minlength=count)
    copied = np.repeat(np.arange(count), np.maximum(offspring - 1, 0))
    return np.flatnonzero(offspring == 0), copied
