"""Fitting one class: hyperparameters by marginal likelihood, noise from residuals of views left out."""

import warnings
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from semantic_slam.geometry.arrays import Array
from semantic_slam.training.viewpoint.samples import ClassSamples
from semantic_slam.viewpoint.directions import Directions
from semantic_slam.viewpoint.gaussian_process import ClassFit, even_azimuths, gram, kernel_of, posterior
from semantic_slam.viewpoint.spherical_process import AZIMUTHS, ELEVATIONS, grid_directions, spherical_posterior

NOISE_AZIMUTHS = 72
SMOOTHING_RAD = np.deg2rad(12.0)
"""Width over which squared residuals are averaged: noise may vary with the direction of view."""
SIGMA_FLOOR = 0.03
"""Least standard deviation of a component's noise; keeps saturated probabilities from claiming certainty."""
LENGTH_BOUNDS = (0.1, 3.0)
"""Bounds of the kernel's length scale, a chord of the unit circle."""
STARTS = tuple((signal, length) for signal in (0.03, 0.1, 0.3, 1.0) for length in (0.1, 0.2, 0.5, 1.0, 2.0))
"""Signal sigmas and length scales, from the likeliest of which the search for greater likelihood starts."""


def fit_class(samples: ClassSamples) -> ClassFit:
    """Model of one class: a Gaussian process per component, and the noise of single views about it."""
    targets = samples.features.mean(axis=1)
    within = _smoothed(samples.directions, _spread(samples), samples.directions)
    variances = (within + SIGMA_FLOOR**2) / samples.features.shape[1]
    prior_mean = targets.mean(axis=0)
    signal, length = _hyperparameters(samples.directions, targets - prior_mean, variances)
    noise = np.zeros((NOISE_AZIMUTHS, targets.shape[1], targets.shape[1]))
    fit = ClassFit(
        azimuth_rad=samples.azimuth_rad,
        targets=targets,
        target_variances=variances,
        prior_mean=prior_mean,
        signal_sigma=signal,
        length_scale=length,
        noise_covariance=noise,
        coverage_rad=_coverage(samples.directions),
        elevation_rad=samples.elevation_rad,
    )
    return with_noise(fit, samples)


def _spread(samples: ClassSamples) -> Array:
    """(M, F) variance of single views: over the draws, or about the views nearby where each direction has one."""
    if samples.features.shape[1] > 1:
        return np.asarray(samples.features.var(axis=1, ddof=1))
    single = samples.features[:, 0]
    return np.asarray((single - _smoothed(samples.directions, single, samples.directions)) ** 2)


def with_noise(fit: ClassFit, samples: ClassSamples) -> ClassFit:
    """The fit with its noise: smoothed products of left-out residuals, scaled to the greatest likelihood.

    The dropout covariance of a measurement is added when the model is used, hence the scale: it keeps what the
    two explain together from being counted twice.
    """
    residuals = samples.features - left_out_means(fit)[:, None, :]
    products = np.einsum("msi,msj->mij", residuals, residuals) / samples.features.shape[1]
    size = products.shape[-1]
    seen, products = samples.directions, products.reshape(-1, size * size)
    directions, shape = _noise_grid(seen)
    on_grid = _smoothed(seen, products, directions).reshape(*shape, size, size)
    at_views = _smoothed(seen, products, seen)
    at_views = at_views.reshape(-1, 1, size, size)
    floor = SIGMA_FLOOR**2 * np.eye(size)
    mean_variance = np.stack([_variance(fit, index) for index in range(size)], axis=-1)
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
        inverse = np.linalg.inv(gram(fit, index))
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


def _hyperparameters(directions: Directions, centred: Array, variances: Array) -> tuple[Array, Array]:
    """(F,) signal sigma and length scale of each component, by marginal likelihood.

    That has several maxima where views are few or change quickly, hence the search from the likeliest of many values.
    """
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel

    inputs = directions.points()
    signal, length = np.empty(centred.shape[1]), np.empty(centred.shape[1])
    for index in range(centred.shape[1]):
        first_signal, first_length = _likeliest_start(directions, centred[:, index], variances[:, index])
        prior = ConstantKernel(first_signal**2, (1e-4, 10.0)) * RBF(first_length, LENGTH_BOUNDS)
        regressor = GaussianProcessRegressor(prior, alpha=variances[:, index], optimizer="fmin_l_bfgs_b")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)  # a bound that is reached is a valid answer here
            regressor.fit(inputs, centred[:, index])
        constant, scale = np.exp(regressor.kernel_.theta)
        signal[index], length[index] = np.sqrt(constant), scale
    return signal, length


def _likeliest_start(directions: Directions, centred: Array, variances: Array) -> tuple[float, float]:
    """The signal sigma and length scale of ``STARTS`` under which (M,) values with these variances are likeliest."""
    cosines, noise = directions.cosines(directions), np.diag(variances)
    return min(STARTS, key=lambda start: gaussian_nll(centred, kernel_of(cosines, *start) + noise))


def _smoothed(directions: Directions, values: Array, at: Directions) -> Array:
    """(M, K) values in M directions to (B, K) in others: average weighted by angular nearness.

    Far from all views it is that of the nearest.
    """
    near = (at.cosines(directions) - 1.0) / SMOOTHING_RAD**2
    if at.elevation_rad is not None:
        near -= near.max(axis=1, keepdims=True)
    closeness = np.exp(near)
    return np.asarray(closeness @ values / closeness.sum(axis=1, keepdims=True))


def _noise_grid(directions: Directions) -> tuple[Directions, tuple[int, ...]]:
    """Directions at which the noise is kept, and in which shape."""
    if directions.elevation_rad is None:
        return Directions(even_azimuths(NOISE_AZIMUTHS)), (NOISE_AZIMUTHS,)
    return grid_directions(), (ELEVATIONS, AZIMUTHS)


def _variance(fit: ClassFit, component: int) -> Array:
    """(M,) posterior variance of a component's mean at the training views."""
    if fit.elevation_rad is None:
        return posterior(fit, component, fit.azimuth_rad)[2]
    return spherical_posterior(fit, component, fit.directions)[4]


def _coverage(directions: Directions) -> float:
    """Largest angle to a view that counts as covered: 1.5 gaps around, or three quarters of that between heights.

    At least the width over which noise is taken to hold, for views of a robot that stands.
    """
    around = max(1.5 * _widest_regular_gap(directions), float(SMOOTHING_RAD))
    if directions.elevation_rad is None:
        return around
    heights = np.unique(np.round(directions.elevation_rad, 6))
    return max(around, 0.75 * _regular(np.diff(heights))) if len(heights) > 1 else around


def _widest_regular_gap(directions: Directions) -> float:
    """Typical angle between neighbouring views around the object; none between views of one azimuth.

    At a height the angle is the gap of azimuths times the cosine of the elevation, of the views nearest to the horizon.
    The widest gap is left out: where there are few views, it is the hole that no view has seen.
    """
    ordered, of_views = np.unique(np.round(directions.azimuth_rad % (2.0 * np.pi), 6), return_inverse=True)
    gaps = np.diff(np.append(ordered, ordered[0] + 2.0 * np.pi))
    if directions.elevation_rad is not None:
        level = np.zeros(len(ordered))
        np.maximum.at(level, of_views, np.cos(directions.elevation_rad))
        gaps *= 0.5 * (level + np.roll(level, -1))
    return _regular(np.sort(gaps)[:-1]) if len(gaps) > 1 else 0.0


def _regular(gaps: Array) -> float:
    """The gap that three quarters of (G,) gaps do not exceed: one of them, never a mean of a regular one and a hole."""
    return float(np.percentile(gaps, 75.0, method="lower"))
