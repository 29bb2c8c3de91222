"""Gaussian process class models over the viewing direction, independent between views (Eqs. 3.8-3.17, 3.47)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.viewpoint.directions import Directions
from semantic_slam.viewpoint.model import Prediction, Viewpoints

GRID = 360
"""Number of azimuths at which the posterior is tabulated; it is interpolated between them."""


@dataclass(frozen=True)
class ClassFit:
    """Fitted Gaussian process of one class: M training views, F feature components, noise at G azimuths."""

    azimuth_rad: Array  # (M,) of the training views
    targets: Array  # (M, F) mean feature of each view
    target_variances: Array  # (M, F) of those means
    prior_mean: Array  # (F,)
    signal_sigma: Array  # (F,) of the squared-exponential kernel
    length_scale: Array  # (F,) of the kernel, a chord on the unit circle
    noise_covariance: Array  # (G, F, F) spread of single views about the mean, at azimuths 2 pi g / G
    coverage_rad: float  # largest angle to a training view that counts as covered
    elevation_rad: Array | None = None  # (M,) of the views; None: all of one height. With it the noise is (E, A, F, F)

    @property
    def directions(self) -> Directions:
        """Directions of the training views."""
        return Directions(self.azimuth_rad, self.elevation_rad)


def kernel(first_rad: Array, second_rad: Array, signal_sigma: float, length_scale: float) -> Array:
    """(A, B) squared-exponential kernel of two sets of azimuths, as points (cos, sin) on the unit circle (Eq. 3.12)."""
    return kernel_of(np.cos(first_rad[:, None] - second_rad[None, :]), signal_sigma, length_scale)


def kernel_of(cosines: Array, signal_sigma: float, length_scale: float) -> Array:
    """Squared-exponential kernel between directions, from the cosines of the angles between them."""
    squared_chord = 2.0 - 2.0 * cosines
    return np.asarray(signal_sigma**2 * np.exp(-0.5 * squared_chord / length_scale**2))


def gram(fit: ClassFit, component: int) -> Array:
    """(M, M) covariance of one component's training targets (kernel plus noise)."""
    sigma, length = float(fit.signal_sigma[component]), float(fit.length_scale[component])
    directions = fit.directions
    shared = kernel_of(directions.cosines(directions), sigma, length)
    return np.asarray(shared + np.diag(fit.target_variances[:, component]))


def posterior(fit: ClassFit, component: int, azimuth_rad: Array) -> tuple[Array, Array, Array]:
    """Mean, slope of the mean [1/rad] and variance of one component at (B,) azimuths (Eqs. 3.15-3.16)."""
    sigma, length = float(fit.signal_sigma[component]), float(fit.length_scale[component])
    known = gram(fit, component)
    weights = np.linalg.solve(known, fit.targets[:, component] - fit.prior_mean[component])
    cross = kernel(azimuth_rad, fit.azimuth_rad, sigma, length)
    difference = azimuth_rad[:, None] - fit.azimuth_rad[None, :]
    slope = (cross * (-np.sin(difference) / length**2)) @ weights
    variance = sigma**2 - np.einsum("bm,mb->b", cross, np.linalg.solve(known, cross.T))
    return fit.prior_mean[component] + cross @ weights, slope, np.maximum(variance, 0.0)


@dataclass(frozen=True)
class PosteriorTable:
    """Posterior of one class at GRID azimuths; stored in the file, so that loading needs no matrix inversion."""

    mean: Array  # (GRID, F)
    slope: Array  # (GRID, F) of the mean, 1/rad
    variance: Array  # (GRID, F) of the mean


def tabulate(fit: ClassFit) -> PosteriorTable:
    """Tabulate the posterior of every component at all azimuths of the grid."""
    parts = [posterior(fit, component, even_azimuths(GRID)) for component in range(fit.targets.shape[1])]
    return PosteriorTable(*(np.stack([part[index] for part in parts], axis=-1) for index in range(3)))


class FittedClasses:
    """Common base of fitted class models."""

    def __init__(self, class_names: tuple[str, ...], feature_names: tuple[str, ...], fits: Sequence[ClassFit]) -> None:
        """One ``ClassFit`` per class; ``feature_names`` (F,) are the classifier's."""
        self._class_names = class_names
        self.feature_names = feature_names
        self.fits = tuple(fits)
        self._coverage_rad = np.array([fit.coverage_rad for fit in self.fits])

    @property
    def class_names(self) -> tuple[str, ...]:
        """Names of the C classes."""
        return self._class_names

    @property
    def num_features(self) -> int:
        """F, components of the feature."""
        return len(self.feature_names)


class GaussianProcessModel(FittedClasses):
    """Class models tabulated over azimuth: a prediction is a table look-up, whatever the number of training views.

    The covariance is that of the noise of single views plus the posterior variance of the mean.
    """

    def __init__(
        self,
        class_names: tuple[str, ...],
        feature_names: tuple[str, ...],
        fits: Sequence[ClassFit],
        tables: Sequence[PosteriorTable] | None = None,
    ) -> None:
        """One ``ClassFit`` per class, with its table where it is known; ``feature_names`` (F,) are the classifier's."""
        super().__init__(class_names, feature_names, fits)
        self.tables = tuple(tables) if tables is not None else tuple(tabulate(fit) for fit in self.fits)
        pairs = zip(self.fits, self.tables, strict=True)
        self._cubics = np.concatenate([_cubics(fit, table) for fit, table in pairs])  # (C GRID, 2 F + F F, 4)
        self._distance = np.concatenate([_distance_to_training(fit) for fit in self.fits])  # (C GRID,)

    def predict(self, classes: Index, viewpoints: Viewpoints) -> Prediction:
        """Mean, covariance and slope for (B,) class indices; only the azimuth matters to these models."""
        count, size = len(classes), len(self.feature_names)
        cell, t = _cell(viewpoints.azimuth_rad)
        powers = np.empty((count, 4, 1))
        powers[:, 0, 0] = 1.0
        powers[:, 1, 0] = t
        powers[:, 2, 0] = t * t
        powers[:, 3, 0] = powers[:, 2, 0] * t
        values = (self._cubics.take(cell + GRID * classes, axis=0) @ powers)[:, :, 0]
        jacobian = np.zeros((count, size, 3))
        jacobian[:, :, 0] = values[:, size : 2 * size]
        return Prediction(values[:, :size], values[:, 2 * size :].reshape(count, size, size), jacobian)

    def in_coverage(self, classes: Index, viewpoints: Viewpoints) -> Flags:
        """(B,) whether a training view of the class lies near this azimuth."""
        cell, t = _cell(viewpoints.azimuth_rad)
        nearest = np.where(t < 0.5, cell, (cell + 1) % GRID)
        return np.asarray(self._distance[nearest + GRID * classes] <= self._coverage_rad[classes])


def _cell(azimuth_rad: Array) -> tuple[Index, Array]:
    """(B,) grid cell of each azimuth and the position 0..1 in it."""
    cell, place = split_at(azimuth_rad * (GRID / (2.0 * np.pi)))
    return cell % GRID, place


def split_at(position: Array) -> tuple[Index, Array]:
    """(B,) integer parts of positions, and their fractional parts 0..1."""
    floor: Array = np.floor(position)
    return floor.astype(np.int64), position - floor


def even_azimuths(count: int) -> Array:
    """(count,) evenly spaced azimuths from 0 over a full turn."""
    return np.asarray(np.arange(count) * (2.0 * np.pi / count), dtype=np.float64)


def _cubics(fit: ClassFit, table: PosteriorTable) -> Array:
    """(GRID, 2 F + F F, 4) cubic polynomials of each cell: mean, its slope, and the row-major covariance.

    The mean is the cubic Hermite interpolant; the slope is its exact derivative, so that the Jacobian is consistent.
    """
    mean, slope, size = table.mean, table.slope * (2.0 * np.pi / GRID), table.mean.shape[1]
    next_mean, next_slope = np.roll(mean, -1, axis=0), np.roll(slope, -1, axis=0)
    rise = next_mean - mean
    square, cube = 3 * rise - 2 * slope - next_slope, slope + next_slope - 2 * rise
    covariance = (_noise_on_grid(fit.noise_covariance) + table.variance[:, :, None] * np.eye(size)).reshape(GRID, -1)
    cubics = np.zeros((GRID, 2 * size + size * size, 4))
    cubics[:, :size] = np.stack([mean, slope, square, cube], axis=-1)
    cubics[:, size : 2 * size, :3] = np.stack([slope, 2 * square, 3 * cube], axis=-1) * (GRID / (2.0 * np.pi))
    cubics[:, 2 * size :, :2] = np.stack([covariance, np.roll(covariance, -1, axis=0) - covariance], axis=-1)
    return cubics


def _noise_on_grid(noise: Array) -> Array:
    """Interpolate (G, F, F) noise linearly to (GRID, F, F); a convex mixture of covariances is a covariance."""
    position = np.arange(GRID) * (len(noise) / GRID)
    low = np.floor(position).astype(int)
    share = (position - low)[:, None, None]
    return np.asarray((1.0 - share) * noise[low] + share * noise[(low + 1) % len(noise)])


def _distance_to_training(fit: ClassFit) -> Array:
    """(GRID,) angle from each azimuth of the grid to the nearest training view."""
    difference = even_azimuths(GRID)[:, None] - fit.azimuth_rad[None, :]
    return np.asarray(np.abs((difference + np.pi) % (2.0 * np.pi) - np.pi).min(axis=1))
