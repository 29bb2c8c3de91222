"""Alg. 3.1 as it is printed: one pose sample at a time, everything from scratch at every step.

Only the covariance form of Eqs. 3.34-3.40 is taken, so that the result is comparable; with ``sigma_n`` test noise.
"""

from collections.abc import Sequence

import numpy as np
from scipy.stats import multivariate_normal

from semantic_slam.classification.class_model import ClassModel
from semantic_slam.classification.classifier import Scores
from semantic_slam.geometry.arrays import Array


class LiteralRecursion:
    """Class posterior along one track, O(k^3) per step; C classes, F components."""

    def __init__(self, models: Sequence[ClassModel]) -> None:
        self.models = models
        self.inverses = [
            [
                np.linalg.inv(
                    _kernel(model, f, model.inputs, model.inputs)
                    + model.noise_sigma[f] ** 2 * np.eye(len(model.inputs))
                )
                for f in range(len(model.noise_sigma))
            ]
            for model in models
        ]

    def step(self, log_posterior: Array, locations_m: Array, scores: Sequence[Scores]) -> Array:
        """(C,) log posterior after view k from that after view k - 1; (k + 1, 2) locations and all scores."""
        likelihoods = [self._likelihood(c, locations_m, scores) for c in range(len(self.models))]
        joint = np.array(likelihoods).T + log_posterior  # (n, C)
        joint -= np.logaddexp.reduce(joint, axis=1, keepdims=True)
        return np.asarray(np.logaddexp.reduce(joint, axis=0) - np.log(len(joint)))

    def _likelihood(self, class_index: int, locations_m: Array, scores: Sequence[Scores]) -> Array:
        """(n,) log density of the newest samples given all earlier clouds."""
        mean, covariance = self._process(class_index, locations_m)
        size = len(scores[0].mean)
        split = len(mean) - size
        gain = covariance[split:, :split] @ np.linalg.inv(covariance[:split, :split]) if split else np.zeros((size, 0))
        clouds = np.zeros((split, split))
        for i in range(len(scores) - 1):
            clouds[i * size : (i + 1) * size, i * size : (i + 1) * size] = scores[i].covariance
        seen = np.concatenate([item.mean for item in scores[:-1]]) if split else np.zeros(0)
        predicted = mean[split:] + gain @ (seen - mean[:split])
        spread = covariance[split:, split:] - gain @ covariance[:split, split:] + gain @ clouds @ gain.T
        return np.asarray(multivariate_normal(predicted, 0.5 * (spread + spread.T)).logpdf(scores[-1].samples))

    def _process(self, class_index: int, locations_m: Array) -> tuple[Array, Array]:
        """Mean and covariance over all views, view by view (Eqs. 3.15-3.16)."""
        model, count = self.models[class_index], len(locations_m)
        size = model.scores.shape[1]
        mean, covariance = np.zeros((count, size)), np.zeros((count, size, count, size))
        for f in range(size):
            cross = _kernel(model, f, locations_m, model.inputs)
            inverse = self.inverses[class_index][f]
            mean[:, f] = cross @ inverse @ model.scores[:, f]
            covariance[:, f, :, f] = _kernel(model, f, locations_m, locations_m) - cross @ inverse @ cross.T
            covariance[:, f, :, f] += model.noise_sigma[f] ** 2 * np.eye(count)
        return mean.ravel(), covariance.reshape(count * size, count * size)


def _kernel(model: ClassModel, component: int, first: Array, second: Array) -> Array:
    scaling = np.linalg.cholesky(np.linalg.inv(model.length_squared[component]))
    difference = (first[:, None] - second[None]) @ scaling
    return np.asarray(model.signal_variance[component] * np.exp(-0.5 * (difference**2).sum(axis=-1)))
