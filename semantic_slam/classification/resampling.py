"""Effective sample size and resampling of weighted samples."""

import numpy as np

from semantic_slam.classification.classifier import normalised
from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.log_space import log_sum_exp


def effective_size(log_weights: Array) -> float:
    """Effective sample size of (P,) samples with these normalised log weights."""
    return float(np.exp(-log_sum_exp(2.0 * log_weights)))


def rejection_control(log_weights: Array, generator: np.random.Generator) -> tuple[Index, Array]:
    """Rejection control: indices of the samples to replace by fresh draws from the target, and all new log weights.

    A sample is kept with probability weight / mean weight, and its weight is then raised to at least the mean, which
    keeps the survivors properly weighted. Kept and fresh samples are two estimates of one average and are weighted by
    their effective sample sizes.
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
    """Systematic resampling: indices to drop, and for each the index copied in its place; weights become even."""
    count = len(log_weights)
    edges = np.cumsum(np.exp(log_weights)) * count
    points = np.arange(count) + generator.random()
    offspring = np.bincount(np.minimum(np.searchsorted(edges, points), count - 1), minlength=count)
    copied = np.repeat(np.arange(count), np.maximum(offspring - 1, 0))
    return np.flatnonzero(offspring == 0), copied
