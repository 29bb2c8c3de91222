"""Class models of the rendered experiments: Gaussian processes fitted to views from a grid around each object."""

import warnings
from dataclasses import dataclass

import numpy as np
from joblib import Parallel, delayed

from semantic_slam.classification.class_model import ClassModel
from semantic_slam.classification.inputs import INPUT_MAPS
from semantic_slam.geometry.arrays import Array
from semantic_slam_lab.studies.rendered.views import CLASSES, LEAST_RANGE_M, Subject, measure

HALF_WIDTH_M = 2.3
MAP_SIZE = 92
"""Cells along each side of a map: 5 cm each."""
INPUT_MAP = "polar"
"""Predicts views left out of the fit better than the location as it is."""
LEAST_NOISE = 0.01
"""Lower bound of sigma_n in the fit, as a share of a probability's range."""


@dataclass(frozen=True)
class TrainedModels:
    """The models of ``CLASSES`` and what they were fitted to."""

    models: tuple[ClassModel, ...]
    locations_m: Array  # (M, 2)
    samples: Array  # (C, M, T, F) dropout samples of the training views
    step_m: float  # of the grid of locations

    @property
    def map_half_width_m(self) -> float:
        """Where the outermost cells of a map end."""
        return float(np.abs(self.locations_m).max() + 0.5 * self.step_m)

    def on_map(self, values: Array) -> Array:
        """(M,) values at the training locations as an (n, n) map, rows along y; NaN where nothing was seen."""
        cells = np.round(self.locations_m / self.step_m).astype(int)
        cells -= cells.min()
        picture = np.full((cells.max() + 1,) * 2, np.nan)
        picture[cells[:, 1], cells[:, 0]] = values
        return picture


def train_models(seed: int, jobs: int, step_m: float) -> TrainedModels:
    """Render every class from a grid, measure, and fit a process per class and component."""
    locations = grid(step_m)
    samples = np.stack(
        [
            measure(Subject(name), locations, (seed, 2, index), jobs, f"training views, {name}")
            for index, name in enumerate(CLASSES)
        ]
    )
    tasks = (delayed(fit_model)(locations, of_class.mean(axis=1)) for of_class in samples)
    return TrainedModels(tuple(Parallel(n_jobs=jobs)(tasks)), locations, samples, step_m)


def grid(step_m: float) -> Array:
    """(N, 2) places of a square grid about the object, without those too near."""
    steps = round(HALF_WIDTH_M / step_m)
    axis = np.arange(-steps, steps + 1) * step_m
    places = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    return np.asarray(places[np.hypot(places[:, 0], places[:, 1]) >= LEAST_RANGE_M])


def map_places(size: int = MAP_SIZE) -> tuple[Array, int]:
    """(size^2, 2) places of a map over the trained area, rows along y, and its size."""
    axis = (np.arange(size) + 0.5) * (2.0 * HALF_WIDTH_M / size) - HALF_WIDTH_M
    return np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2), size


def fit_model(locations_m: Array, scores: Array, input_map: str = INPUT_MAP) -> ClassModel:
    """Hyperparameters of each component by marginal likelihood; (M, 2) locations and (M, F) mean scores."""
    inputs = INPUT_MAPS[input_map](locations_m)
    fitted = np.array([_hyperparameters(inputs, column) for column in scores.T])  # (F, 2 + D)
    lengths = fitted[:, 2:]
    return ClassModel(
        inputs=inputs,
        scores=scores,
        signal_variance=fitted[:, 0],
        length_squared=np.stack([np.diag(row**2) for row in lengths]),
        noise_sigma=np.sqrt(fitted[:, 1]),
    )


def _hyperparameters(inputs: Array, values: Array) -> Array:
    """sigma^2, sigma_n^2 and a length per input of one component (Eqs. 3.8, 3.12)."""
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    prior = ConstantKernel(0.3, (1e-3, 10.0)) * RBF(np.full(inputs.shape[1], 0.6), (0.1, 10.0))
    regressor = GaussianProcessRegressor(prior + WhiteKernel(0.05**2, (LEAST_NOISE**2, 1.0)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # a bound that is reached is a valid answer here
        regressor.fit(inputs, values)
    constant, *lengths, noise = np.exp(regressor.kernel_.theta)
    return np.array([constant, noise, *lengths])
