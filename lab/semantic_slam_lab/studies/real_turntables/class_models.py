"""Gaussian process class models over the direction of view, from scores of views every 20 degrees."""

import warnings

import numpy as np

from semantic_slam.classification.class_model import ClassModel
from semantic_slam.classification.inputs import INPUT_MAPS
from semantic_slam.geometry.arrays import Array

INPUT_MAP = "unit_circle"
LEAST_NOISE = 0.01
"""Lower bound of sigma_n in the fit, as a share of a probability's range."""


def fit_model(places_m: Array, scores: Array) -> ClassModel:
    """Hyperparameters of each component by marginal likelihood; (M, 2) places and (M, F) mean scores."""
    inputs = INPUT_MAPS[INPUT_MAP](places_m)
    fitted = np.array([_hyperparameters(inputs, column) for column in scores.T])  # (F, 3)
    return ClassModel(
        inputs=inputs,
        scores=scores,
        signal_variance=fitted[:, 0],
        length_squared=np.stack([length**2 * np.eye(2) for length in fitted[:, 1]]),
        noise_sigma=np.sqrt(fitted[:, 2]),
    )


def _hyperparameters(inputs: Array, values: Array) -> Array:
    """sigma^2, length and sigma_n^2 of one component (Eqs. 3.8, 3.12); one length, as no direction is special."""
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    prior = ConstantKernel(0.3, (1e-3, 10.0)) * RBF(0.6, (0.1, 10.0))
    regressor = GaussianProcessRegressor(prior + WhiteKernel(0.05**2, (LEAST_NOISE**2, 1.0)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # a bound that is reached is a valid answer here
        regressor.fit(inputs, values)
    return np.asarray(np.exp(regressor.kernel_.theta))
