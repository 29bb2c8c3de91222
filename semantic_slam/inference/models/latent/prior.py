"""Prior of descriptors from a map's class probabilities, through the classes that ground the latent space."""

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.latent.model import DescriptorBelief, DescriptorModel

DRAWS = 4096
LEAST_SHARE = 0.01
"""Effective share of the samples below which a class is too uninformative to be told apart from the whole prior."""


def prior_of_classes(model: DescriptorModel, class_probabilities: Array) -> DescriptorBelief:
    """Moments of sum_c P(c) P(e | c) within the model's prior, B = 1; the prior itself if classes are not grounded.

    ``class_probabilities`` (C,) are those of a map. The prior is sampled, and samples are weighed by the class
    densities.
    """
    prior = model.prior
    told = np.asarray(class_probabilities, dtype=np.float64)
    if not len(told) or np.ptp(told) < 1e-9:
        return prior
    normals = np.random.default_rng(DRAWS).standard_normal((DRAWS, prior.mean.shape[1]))
    points = prior.mean + prior.sigma * normals
    log_density = model.class_log_likelihood(DescriptorBelief(points, np.zeros_like(points)))
    joint = np.exp(log_density - log_density.max())
    weights = (joint / joint.sum(axis=0)) @ told
    weights /= weights.sum()
    if 1.0 / (weights**2).sum() < LEAST_SHARE * DRAWS:
        return prior
    mean = weights @ points
    return DescriptorBelief(mean[None], np.sqrt(weights @ (points - mean) ** 2)[None])
