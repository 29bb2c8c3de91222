"""Correlated class models: the views of an object under one class are jointly Gaussian (Eqs. 3.13-3.17).

The scores of V views are N(mu_s, Sigma_s + Sigma_e) (the coherent noisy process), where Sigma_s is the posterior
covariance of the process. The error Sigma_e of a view combines the single-view noise and the network's own uncertainty
Sigma_z. The latter concerns the network's weights and so repeats when a view repeats; both are correlated between views
by the kernel. The variation between views from one direction (``sigma_view``) is equal for all classes: otherwise a
hundred equal images would favour the class that expects the least variation.

Score components are treated one by one. They sum to one, so where a view confuses two classes, one component gains what
the other loses; treated as independent, every error would count twice. Log densities are therefore scaled by ``share``.
"""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.log_space import LOG_2PI
from semantic_slam.geometry.rows import take
from semantic_slam.viewpoint.gaussian_process import GRID, ClassFit, GaussianProcessModel, even_azimuths, gram, kernel

MAX_BATCH_NUMBERS = 4_000_000
"""Total number of matrix entries that are factored in one batch."""


@dataclass(frozen=True)
class Evidence:
    """Log evidence of V views along B tracks under C classes, and the contribution of the newest view."""

    log_likelihood: Array  # (B, C) of all views
    newest: Array  # (B, C) of the newest view given the others
    innovation: Array  # (B, C, F) newest feature minus its prediction from the others
    variance: Array  # (B, C, F) of that prediction, without the newest view's own dropout variance
    share: float  # factor by which the components' log densities are scaled

    def of_newest(self, offsets: Array) -> Array:
        """(B, C, M) log density of the newest feature shifted by (M, F) offsets, without dropout variance."""
        moved = self.innovation[:, :, None, :] + offsets
        variance = self.variance[:, :, None, :]
        return np.asarray(self.share * -0.5 * (moved**2 / variance + np.log(variance) + LOG_2PI).sum(axis=-1))

    def rows(self, selection: slice) -> "Evidence":
        """Evidence of the selected rows of the B tracks."""
        return take(self, selection, ("log_likelihood", "newest", "innovation", "variance"))


def joined(parts: list[Evidence]) -> Evidence:
    """Concatenate the evidence of several batches along B."""
    return Evidence(
        np.concatenate([part.log_likelihood for part in parts]),
        np.concatenate([part.newest for part in parts]),
        np.concatenate([part.innovation for part in parts]),
        np.concatenate([part.variance for part in parts]),
        parts[0].share,
    )


class CorrelatedModel:
    """Per class: mean and noise tabulated over azimuth, and covariance over pairs of azimuths."""

    def __init__(self, model: GaussianProcessModel, sigma_view: float) -> None:
        """``sigma_view``: standard deviation of a score between views from the same direction."""
        self.class_names, self.num_features = model.class_names, model.num_features
        self.independent = model
        self._view_variance = sigma_view**2
        self._mean = np.stack([table.mean.T for table in model.tables])  # (C, F, GRID)
        self._covariance = np.stack([_posterior_covariance(fit) for fit in model.fits])  # (C, F, GRID, GRID)
        self._noise = np.stack([_noise_variance(fit) for fit in model.fits])  # (C, F, GRID)
        self._correlation = np.stack([_correlation(fit) for fit in model.fits])  # (C, F, GRID), over the difference

    def evidence(self, azimuth_rad: Array, features: Array, variances: Array) -> Evidence:
        """Evidence of V views, the newest last: azimuths (B, V), features and their dropout variances (B, V, F)."""
        count, views = azimuth_rad.shape
        numbers = self._covariance.shape[0] * self._covariance.shape[1] * views * views
        step = max(1, MAX_BATCH_NUMBERS // numbers)
        parts = [
            self._batch(azimuth_rad[i : i + step], features[i : i + step], variances[i : i + step])
            for i in range(0, count, step)
        ]
        return joined(parts)

    def _batch(self, azimuth_rad: Array, features: Array, variances: Array) -> Evidence:
        cell = np.round(azimuth_rad * (GRID / (2.0 * np.pi))).astype(np.int64) % GRID  # (B, V)
        residual = np.moveaxis(features, -1, 1)[:, None] - np.moveaxis(self._mean[:, :, cell], 2, 0)  # (B, C, F, V)
        first, second = cell[:, :, None], cell[:, None, :]
        covariance = np.moveaxis(self._covariance[:, :, first, second], 2, 0)  # (B, C, F, V, V)
        correlation = np.moveaxis(self._correlation[:, :, (first - second) % GRID], 2, 0)
        own = np.moveaxis(variances, -1, 1)[:, None]  # (B, 1, F, V)
        noise = np.moveaxis(self._noise[:, :, cell], 2, 0)
        for error in (np.broadcast_to(own, noise.shape), noise):
            sigma = np.sqrt(error)
            covariance += correlation * sigma[..., :, None] * sigma[..., None, :]
        diagonal = np.arange(cell.shape[1])
        covariance[..., diagonal, diagonal] += self._view_variance
        root = np.linalg.cholesky(covariance)
        whitened = np.linalg.solve(root, residual[..., None])[..., 0]
        scale = root[..., diagonal, diagonal]
        share = 1.0 / min(self.num_features, 2)
        terms = share * (-0.5 * (whitened**2 + LOG_2PI) - np.log(scale)).sum(axis=2)  # (B, C, V)
        newest_scale = scale[..., -1]
        variance = np.maximum(newest_scale**2 - own[..., -1], self._view_variance)
        return Evidence(terms.sum(axis=-1), terms[..., -1], whitened[..., -1] * newest_scale, variance, share)


def _posterior_covariance(fit: ClassFit) -> Array:
    """(F, GRID, GRID) covariance of the mean at pairs of azimuths (Eq. 3.16)."""
    grid = even_azimuths(GRID)
    parts = []
    for component in range(fit.targets.shape[1]):
        sigma, length = float(fit.signal_sigma[component]), float(fit.length_scale[component])
        cross = np.linalg.solve(np.linalg.cholesky(gram(fit, component)), kernel(fit.azimuth_rad, grid, sigma, length))
        parts.append(kernel(grid, grid, sigma, length) - cross.T @ cross)
    return np.stack(parts)


def _noise_variance(fit: ClassFit) -> Array:
    """(F, GRID) variance of single views about the mean."""
    variances = np.diagonal(fit.noise_covariance, axis1=-2, axis2=-1).T  # (F, G)
    known = even_azimuths(variances.shape[1])
    return np.stack([np.interp(even_azimuths(GRID), known, row, period=2.0 * np.pi) for row in variances])


def _correlation(fit: ClassFit) -> Array:
    """(F, GRID) kernel correlation between directions, by their separation in grid cells."""
    return np.stack([kernel(even_azimuths(GRID), np.zeros(1), 1.0, float(length))[:, 0] for length in fit.length_scale])
