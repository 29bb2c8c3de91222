"""Posterior of every class's processes at the views of a track, grown view by view (Eqs. 3.13-3.17)."""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from typing import Literal

import numpy as np

from semantic_slam.classification.class_model import ClassModel
from semantic_slam.classification.growing_gaussian import RELATIVE_FLOOR
from semantic_slam.classification.inputs import INPUT_MAPS
from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array

TestNoise = Literal["sigma_n", "none"]
ViewNoise = Literal["independent", "kernel"]

RELATIVE_LOSS = 1e-14
"""Eigen-directions of the training data that change covariances by less than this share of sigma^2 are dropped."""


@dataclass(frozen=True)
class Marginals:
    """One view of P tracks under C classes and F components: marginal moments and data for cross-covariances."""

    scaled: Array  # (P, C, F, D) input scaled by the kernel's length scales
    whitened: Array  # (P, C, F, R) covariance with the training scores, whitened
    mean: Array  # (P, C, F), Eq. 3.15
    variance: Array  # (P, C, F), diagonal of Eq. 3.16 with the test noise


class ClassProcesses:
    """C classes x F components, each an independent Gaussian process given its training views.

    ``test_noise``: "sigma_n" adds the noise of Eq. 3.8 to every view of the track; "none" is Eq. 3.13 as printed.
    ``view_noise``: that noise is "independent" between views, or correlated by the kernel ("kernel"), so that a
    repeated viewpoint adds no information.
    """

    def __init__(
        self,
        models: Sequence[ClassModel],
        *,
        test_noise: TestNoise = "sigma_n",
        view_noise: ViewNoise = "independent",
        input_map: str = "location",
    ) -> None:
        if len({(model.inputs.shape[1], model.scores.shape[1]) for model in models}) != 1:
            raise InputError("class models: inputs and components have to be the same for all classes")
        self.num_classes, self.num_components = len(models), models[0].scores.shape[1]
        self.num_inputs = models[0].inputs.shape[1]  # D
        signal_variance = np.stack([model.signal_variance for model in models])  # (C, F)
        self.least_variance = RELATIVE_FLOOR * float(signal_variance.max())
        self._map = INPUT_MAPS[input_map]
        noise = np.stack([model.noise_sigma**2 for model in models]) if test_noise == "sigma_n" else 0.0
        self._correlated_variance = signal_variance + (noise if view_noise == "kernel" else 0.0)
        self._own_variance = signal_variance + noise
        self._classes = [_Trained.of(model) for model in models]
        self.rank = max(trained.projection.shape[-1] for trained in self._classes)

    def only(self, class_index: int) -> "ClassProcesses":
        """The Gaussian processes of one class alone."""
        one, rows = copy(self), slice(class_index, class_index + 1)
        one.num_classes, one._classes = 1, self._classes[rows]
        one._own_variance, one._correlated_variance = self._own_variance[rows], self._correlated_variance[rows]
        return one

    def marginals(self, locations_m: Array) -> Marginals:
        """Predicted scores at one view from (P, 2) locations relative to the object, one for each track."""
        inputs = self._map(np.asarray(locations_m, dtype=np.float64))
        parts = [trained.at(inputs, self.rank) for trained in self._classes]
        scaled, whitened, mean = (np.stack([part[i] for part in parts], axis=1) for i in range(3))
        return Marginals(scaled, whitened, mean, self._own_variance - np.einsum("pcfr,pcfr->pcf", whitened, whitened))

    def covariances(self, scaled: Array, whitened: Array, new: Marginals) -> Array:
        """(P, C, F, k) covariances of a new view with k earlier (P, C, F, k, D) and (P, C, F, k, R) (Eq. 3.16)."""
        shared = _correlation(scaled, new.scaled[..., None, :])
        shared *= self._correlated_variance[..., None]
        shared -= (whitened @ new.whitened[..., None])[..., 0]
        return shared

    def posterior(self, locations_m: Array) -> tuple[Array, Array]:
        """(C, K, F) mean and (C, F, K, K) covariance over a whole track of (K, 2) locations (Eqs. 3.15-3.16)."""
        views = self.marginals(locations_m)
        rows = [np.moveaxis(value, 0, -2) for value in (views.scaled, views.whitened)]  # (C, F, K, ·)
        correlation = _correlation(rows[0][..., :, None, :], rows[0][..., None, :, :])
        covariance = self._correlated_variance[..., None, None] * correlation
        covariance += (self._own_variance - self._correlated_variance)[..., None, None] * np.eye(len(locations_m))
        return views.mean.swapaxes(0, 1), covariance - rows[1] @ rows[1].swapaxes(-1, -2)


@dataclass(frozen=True)
class _Trained:
    """Precomputed processes of one class; whitening turns k(x, X_T) H k(X_T, x') into a product of short vectors."""

    scaling: Array  # (F, D, D), x -> input in length scales
    inputs: Array  # (F, M, D), training inputs in length scales
    signal_variance: Array  # (F,)
    weights: Array  # (F, M), H S_T of Eq. 3.15
    projection: Array  # (F, M, R)

    @classmethod
    def of(cls, model: ClassModel) -> "_Trained":
        scaling = np.swapaxes(np.linalg.cholesky(np.linalg.inv(model.length_squared)), -1, -2)
        inputs = np.einsum("fde,me->fmd", scaling, model.inputs)
        gram = _kernel(inputs, inputs, model.signal_variance)
        eigenvalues, vectors = np.linalg.eigh(gram)  # (F, M), (F, M, M)
        eigenvalues = np.maximum(eigenvalues, 0.0)
        total = eigenvalues + model.noise_sigma[:, None] ** 2
        # |v.k(x)|^2 <= eigenvalue * sigma^2 at every x, which bounds what leaving v out can change
        kept = (eigenvalues > RELATIVE_LOSS * total) & (total > RELATIVE_LOSS * total.max(axis=1, keepdims=True))
        inverse = np.where(kept, 1.0 / np.where(kept, total, 1.0), 0.0)
        projected = np.einsum("fmr,mf->fr", vectors, model.scores)
        rank = int(kept.sum(axis=1).max())
        projection = vectors[..., -rank:] * np.sqrt(inverse[:, None, -rank:])
        weights = np.einsum("fmr,fr->fm", vectors, inverse * projected)
        return cls(scaling, inputs, model.signal_variance, weights, projection)

    def at(self, inputs: Array, rank: int) -> tuple[Array, Array, Array]:
        """Scaled (P, F, D), whitened and padded (P, F, rank), and mean (P, F) at (P, D) inputs."""
        scaled = np.einsum("fde,pe->fpd", self.scaling, inputs)
        cross = _kernel(scaled, self.inputs, self.signal_variance)
        whitened = cross @ self.projection
        padded = np.zeros((*whitened.shape[:2], rank))
        padded[..., : whitened.shape[-1]] = whitened
        mean = (cross @ self.weights[..., None])[..., 0]
        return scaled.swapaxes(0, 1), padded.swapaxes(0, 1), mean.T


def _kernel(first: Array, second: Array, signal_variance: Array) -> Array:
    """(F, A, B) squared-exponential kernel of (F, A, D) and (F, B, D) scaled inputs (Eq. 3.12)."""
    return signal_variance[:, None, None] * _correlation(first[:, :, None, :], second[:, None, :, :])


def _correlation(first: Array, second: Array) -> Array:
    """(...,) squared-exponential correlation of (..., D) scaled inputs; dimension by dimension, which is fast."""
    squared = np.square(first[..., 0] - second[..., 0])
    for dimension in range(1, first.shape[-1]):
        squared += np.square(first[..., dimension] - second[..., dimension])
    squared *= -0.5
    return np.asarray(np.exp(squared, out=squared))
