"""Class models whose error repeats: the views of an object under one class are jointly Gaussian (Eqs. 3.13-3.17).

The scores of V views are N(mu_s, Sigma_s + Sigma_z) (the coherent noisy process), with Sigma_s the posterior
covariance of the process plus the noise of single views. That noise has the kernel's correlation between views,
so that a view from where one was before brings next to nothing. Components are independent of each other.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from semantic_slam.viewpoint.gaussian_process import GRID, ClassFit, GaussianProcessModel, even_azimuths, kernel
from semantic_slam.viewpoint.model import Array

LOG_2PI = float(np.log(2.0 * np.pi))
SIGMA_REPEAT = 0.01
"""Standard deviation of a score about itself when everything else is the same: images are never quite equal."""
MAX_BATCH_NUMBERS = 4_000_000
"""Matrices of so many numbers altogether are factored at once."""


@dataclass(frozen=True)
class Evidence:
    """log p of V views along B tracks under C classes, and what the newest of them adds."""

    log_likelihood: Array  # (B, C) of all views
    newest: Array  # (B, C) of the newest given the others
    innovation: Array  # (B, C, F) newest feature minus its prediction from the others
    variance: Array  # (B, C, F) of that prediction, without the newest view's own dropout variance

    def of_newest(self, offsets: Array) -> Array:
        """(B, C, M) log density of the newest feature moved by (M, F) offsets, known exactly."""
        moved = self.innovation[:, :, None, :] + offsets
        variance = self.variance[:, :, None, :]
        return np.asarray(-0.5 * (moved**2 / variance + np.log(variance) + LOG_2PI).sum(axis=-1))


class CorrelatedModel:
    """Tables over azimuth of the mean, and over pairs of azimuths of the covariance, of every class and component."""

    def __init__(self, model: GaussianProcessModel) -> None:
        self.class_names, self.num_features = model.class_names, model.num_features
        self.independent = model
        self._mean = np.stack([table.mean.T for table in model.tables])  # (C, F, GRID)
        self._covariance = np.stack([_covariance(fit) for fit in model.fits])  # (C, F, GRID, GRID)

    def evidence(self, azimuth_rad: Array, features: Array, variances: Array) -> Evidence:
        """Of V views, the newest last: azimuths (B, V), features (B, V, F) and their dropout variances (B, V, F)."""
        count, views = azimuth_rad.shape
        numbers = self._covariance.shape[0] * self._covariance.shape[1] * views * views
        step = max(1, MAX_BATCH_NUMBERS // numbers)
        parts = [
            self._batch(azimuth_rad[i : i + step], features[i : i + step], variances[i : i + step])
            for i in range(0, count, step)
        ]
        return Evidence(*(np.concatenate([vars(part)[name] for part in parts]) for name in vars(parts[0])))

    def _batch(self, azimuth_rad: Array, features: Array, variances: Array) -> Evidence:
        cell = np.round(azimuth_rad * (GRID / (2.0 * np.pi))).astype(np.int64) % GRID  # (B, V)
        spread = np.moveaxis(variances, -1, 1)[:, None] + SIGMA_REPEAT**2  # (B, 1, F, V)
        residual = np.moveaxis(features, -1, 1)[:, None] - np.moveaxis(self._mean[:, :, cell], 2, 0)  # (B, C, F, V)
        covariance = np.moveaxis(self._covariance[:, :, cell[:, :, None], cell[:, None, :]], 2, 0)
        diagonal = np.arange(cell.shape[1])
        covariance[..., diagonal, diagonal] += spread
        root = np.linalg.cholesky(covariance)
        whitened = np.linalg.solve(root, residual[..., None])[..., 0]
        scale = root[..., diagonal, diagonal]
        terms = (-0.5 * (whitened**2 + LOG_2PI) - np.log(scale)).sum(axis=2)  # (B, C, V)
        newest_scale = scale[..., -1]
        own = variances[:, None, -1, :]
        variance = np.maximum(newest_scale**2 - own, SIGMA_REPEAT**2)
        return Evidence(terms.sum(axis=-1), terms[..., -1], whitened[..., -1] * newest_scale, variance)


def _covariance(fit: ClassFit) -> NDArray[np.float64]:
    """(F, GRID, GRID) covariance of single views at pairs of azimuths: that of the mean, and of the noise."""
    grid = even_azimuths(GRID)
    parts = []
    for component in range(fit.targets.shape[1]):
        sigma, length = float(fit.signal_sigma[component]), float(fit.length_scale[component])
        gram = kernel(fit.azimuth_rad, fit.azimuth_rad, sigma, length) + np.diag(fit.target_variances[:, component])
        cross = np.linalg.solve(np.linalg.cholesky(gram), kernel(fit.azimuth_rad, grid, sigma, length))
        of_mean = kernel(grid, grid, sigma, length) - cross.T @ cross
        noise = np.interp(
            grid, even_azimuths(len(fit.noise_covariance)), np.sqrt(fit.noise_covariance[:, component, component]),
            period=2.0 * np.pi,
        )  # fmt: skip
        parts.append(of_mean + kernel(grid, grid, 1.0, length) * np.outer(noise, noise))
    return np.stack(parts)
