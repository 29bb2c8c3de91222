"""Fitting one class: hyperparameters by marginal likelihood, noise from residuals of views left out."""

import warnings
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from semantic_slam.geometry.arrays import Array
from semantic_slam.training.viewpoint.samples import ClassSamples
from semantic_slam.viewpoint.gaussian_process import ClassFit, even_azimuths, kernel, posterior

NOISE_AZIMUTHS = 72
SMOOTHING_RAD = np.deg2rad(12.0)
"""Width over which squared residuals are averaged: noise may vary with the direction of view."""
SIGMA_FLOOR = 0.03
"""Least standard deviation of a component's noise; keeps saturated probabilities from claiming certainty."""
LENGTH_BOUNDS = (0.1, 3.0)
"""Bounds of the kernel's length scale, a chord of the unit circle."""


def fit_class(samples: ClassSamples) -> ClassFit:
    """Model of one class: a Gaussian process per component, and the noise of single views about it."""
    targets = samples.features.mean(axis=1)
    within = _smoothed(samples.azimuth_rad, _spread(samples), samples.azimuth_rad)
    variances = (within + SIGMA_FLOOR**2) / samples.features.shape[1]
    prior_mean = targets.mean(axis=0)
    signal, length = _hyperparameters(samples.azimuth_rad, targets - prior_mean, variances)
    noise = np.zeros((NOISE_AZIMUTHS, targets.shape[1], targets.shape[1]))
    coverage = 1.5 * _widest_regular_gap(samples.azimuth_rad)
    fit = ClassFit(samples.azimuth_rad, targets, variances, prior_mean, signal, length, noise, coverage)
    return with_noise(fit, samples)


def _spread(samples: ClassSamples) -> Array:
    """(M, F) variance of single views: over the draws, or about the views nearby where each direction has one."""
    if samples.features.shape[1] > 1:
        return np.asarray(samples.features.var(axis=1, ddof=1))
    single = samples.features[:, 0]
    return np.asarray((single - _smoothed(samples.azimuth_rad, single, samples.azimuth_rad)) ** 2)


def with_noise(fit: ClassFit, samples: ClassSamples) -> ClassFit:
    """The fit with its noise: smoothed products of left-out residuals, scaled to the greatest likelihood.

    The dropout covariance of a measurement is added when the model is used, hence the scale: it keeps what the
    two explain together from being counted twice.
    """
    residuals = samples.features - left_out_means(fit)[:, None, :]
    products = np.einsum("msi,msj->mij", residuals, residuals) / samples.features.shape[1]
    size = products.shape[-1]
    directions = even_azimuths(NOISE_AZIMUTHS)
    on_grid = _smoothed(samples.azimuth_rad, products.reshape(-1, size * size), directions).reshape(-1, size, size)
    at_views = _smoothed(samples.azimuth_rad, products.reshape(-1, size * size), samples.azimuth_rad)
    at_views = at_views.reshape(-1, 1, size, size)
    floor = SIGMA_FLOOR**2 * np.eye(size)
    mean_variance = np.stack([posterior(fit, index, samples.azimuth_rad)[2] for index in range(size)], axis=-1)
    known = samples.feature_covariances + (mean_variance[:, :, None] * np.eye(size))[:, None] + floor

    def negative_log_likelihood(log_scale: float) -> float:
        return gaussian_nll(residuals, known + np.exp(log_scale) * at_views)

    log_scale = minimize_scalar(negative_log_likelihood, bounds=(-4.0, 2.0), method="bounded").x
    noise = np.exp(log_scale) * on_grid + floor
    return replace(fit, noise_covariance=noise)


def left_out_means(fit: ClassFit) -> Array:
    """(M, F) posterior mean at each training view with that view left out, in closed form."""
    means = np.empty_like(fit.targets)
    for index in range(fit.targets.shape[1]):
        sigma, length = float(fit.signal_sigma[index]), float(fit.length_scale[index])
        gram = kernel(fit.azimuth_rad, fit.azimuth_rad, sigma, length) + np.diag(fit.target_variances[:, index])
        inverse = np.linalg.inv(gram)
        weights = inverse @ (fit.targets[:, index] - fit.prior_mean[index])
        means[:, index] = fit.targets[:, index] - weights / np.diag(inverse)
    return means


def gaussian_nll(residuals: Array, covariances: Array) -> float:
    """Mean negative log density, in nats, of (..., F) residuals under (..., F, F) covariances."""
    squared, logdet = whitened_squared(residuals, covariances), np.linalg.slogdet(covariances)[1]
    return float(np.mean(0.5 * (squared + logdet + residuals.shape[-1] * np.log(2.0 * np.pi))))


def whitened_squared(residuals: Array, covariances: Array) -> Array:
    """(...,) squared Mahalanobis norm of (..., F) residuals; F on average when the covariances are right."""
    solved = np.linalg.solve(covariances, residuals[..., None])[..., 0]
    return np.asarray(np.sum(residuals * solved, axis=-1))


def _hyperparameters(azimuth_rad: Array, centred: Array, variances: Array) -> tuple[Array, Array]:
    """(F,) signal sigma and length scale of each component, by marginal likelihood."""
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel

    inputs = np.stack([np.cos(azimuth_rad), np.sin(azimuth_rad)], axis=-1)
    signal, length = np.empty(centred.shape[1]), np.empty(centred.shape[1])
    for index in range(centred.shape[1]):
        prior = ConstantKernel(0.1, (1e-4, 10.0)) * RBF(0.5, LENGTH_BOUNDS)
        regressor = GaussianProcessRegressor(prior, alpha=variances[:, index], optimizer="fmin_l_bfgs_b")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)  # a bound that is reached is a valid answer here
            regressor.fit(inputs, centred[:, index])
        constant, scale = np.exp(regressor.kernel_.theta)
        signal[index], length[index] = np.sqrt(constant), scale
    return signal, length


def _smoothed(azimuth_rad: Array, values: Array, at_rad: Array) -> Array:
    """(M, K) values at M azimuths to (B, K) at others: average weighted by angular nearness."""
    closeness = np.exp((np.cos(at_rad[:, None] - azimuth_rad[None, :]) - 1.0) / SMOOTHING_RAD**2)
    return np.asarray(closeness @ values / closeness.sum(axis=1, keepdims=True))


def _widest_regular_gap(azimuth_rad: Array) -> float:
    """Typical angle between neighbouring views: the 75th percentile, so that a hole does not count as covered."""
    ordered = np.sort(np.unique(np.round(azimuth_rad % (2.0 * np.pi), 6)))
    gaps = np.diff(np.append(ordered, ordered[0] + 2.0 * np.pi))
    return float(np.percentile(gaps, 75.0))
