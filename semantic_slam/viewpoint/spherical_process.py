"""Gaussian process class models over azimuth and elevation, the spherical form of the azimuth-only models.

The kernel is the squared exponential of chord lengths on the unit sphere (Eq. 3.12), so that views from above are alike
whatever their azimuth. The posterior is tabulated; its mean is interpolated by bicubic patches with exact slopes.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.viewpoint.directions import Directions
from semantic_slam.viewpoint.gaussian_process import (
    ClassFit,
    FittedClasses,
    GaussianProcessModel,
    gram,
    kernel_of,
    split_at,
)
from semantic_slam.viewpoint.model import Prediction, Viewpoints

AZIMUTHS, ELEVATIONS = 72, 37
"""Table size: every five degrees of azimuth, and of elevation from straight below to straight above."""
STEP_RAD = 2.0 * np.pi / AZIMUTHS
HERMITE = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [-3.0, 3.0, -2.0, -1.0], [2.0, -2.0, 1.0, 1.0]])
"""Hermite basis: from values and slopes at both ends of a cell to the cubic's coefficients."""


def grid_directions() -> Directions:
    """Directions of the table, ordered by elevation, then azimuth."""
    elevation = -0.5 * np.pi + STEP_RAD * np.arange(ELEVATIONS, dtype=np.float64)
    azimuth = STEP_RAD * np.arange(AZIMUTHS, dtype=np.float64)
    return Directions(np.tile(azimuth, ELEVATIONS), np.repeat(elevation, AZIMUTHS))


@dataclass(frozen=True)
class SphericalTable:
    """Posterior of one class at all directions of the grid, as stored in the file."""

    mean: Array  # (ELEVATIONS, AZIMUTHS, F)
    by_azimuth: Array  # of the same shape, slope of the mean, 1/rad
    by_elevation: Array
    twist: Array  # mixed derivative by azimuth and elevation
    variance: Array  # of the mean


def tabulate_sphere(fit: ClassFit) -> SphericalTable:
    """Tabulate the posterior of every component at all directions of the grid."""
    parts = [spherical_posterior(fit, component, grid_directions()) for component in range(fit.targets.shape[1])]
    shape = ELEVATIONS, AZIMUTHS, len(parts)
    return SphericalTable(*(np.stack([part[row] for part in parts], axis=-1).reshape(shape) for row in range(5)))


def spherical_posterior(fit: ClassFit, component: int, at: Directions) -> tuple[Array, Array, Array, Array, Array]:
    """Posterior of one component at B directions: mean, slopes by azimuth, elevation and both, and variance."""
    assert fit.elevation_rad is not None and at.elevation_rad is not None
    sigma, length = float(fit.signal_sigma[component]), float(fit.length_scale[component])
    known = gram(fit, component)
    weights = np.linalg.solve(known, fit.targets[:, component] - fit.prior_mean[component])
    cross = kernel_of(at.cosines(fit.directions), sigma, length)
    off = at.azimuth_rad[:, None] - fit.azimuth_rad[None, :]
    up, level = np.sin(at.elevation_rad)[:, None], np.cos(at.elevation_rad)[:, None]
    their_up, their_level = np.sin(fit.elevation_rad), np.cos(fit.elevation_rad)
    around = -level * their_level * np.sin(off) / length**2
    above = (level * their_up - up * their_level * np.cos(off)) / length**2
    both = around * above + up * their_level * np.sin(off) / length**2
    variance = sigma**2 - np.einsum("bm,mb->b", cross, np.linalg.solve(known, cross.T))
    mean, *slopes = ((cross * factor) @ weights for factor in (1.0, around, above, both))
    return fit.prior_mean[component] + mean, slopes[0], slopes[1], slopes[2], np.maximum(variance, 0.0)


class SphericalProcessModel(FittedClasses):
    """Class models tabulated over azimuth and elevation: a prediction is a table look-up.

    The covariance is that of the noise of single views plus the posterior variance of the mean.
    """

    def __init__(
        self,
        class_names: tuple[str, ...],
        feature_names: tuple[str, ...],
        fits: Sequence[ClassFit],
        tables: Sequence[SphericalTable] | None = None,
    ) -> None:
        """One ``ClassFit`` per class, with its table where it is known; ``feature_names`` (F,) are the classifier's."""
        super().__init__(class_names, feature_names, fits)
        self.tables = tuple(tables) if tables is not None else tuple(tabulate_sphere(fit) for fit in self.fits)
        pairs = list(zip(self.fits, self.tables, strict=True))
        self._patches = np.concatenate([_patches(table) for table in self.tables])  # (C cells, F, 4, 4)
        self._covariances = np.concatenate([_covariances(fit, table) for fit, table in pairs])  # (C grid, F F)
        self._cosines = np.concatenate([_nearest(fit) for fit in self.fits])  # (C grid,)

    @property
    def elevations_rad(self) -> tuple[float, ...]:
        """Elevations of the training views, rounded to the table's step."""
        told = [fit.elevation_rad for fit in self.fits if fit.elevation_rad is not None]
        steps = {round(own / STEP_RAD) for elevations in told for own in elevations.tolist()}
        return tuple(STEP_RAD * step for step in sorted(steps))

    def predict(self, classes: Index, viewpoints: Viewpoints) -> Prediction:
        """Mean, covariance and slopes for (B,) class indices; independent of the range."""
        count, size = len(classes), self.num_features
        at, azimuth, elevation = _cells(viewpoints)
        patches = self._patches.take(at + AZIMUTHS * (ELEVATIONS - 1) * classes, axis=0)
        powers, slopes = _powers(elevation)
        by_power, rising = patches @ powers[:, None, :, None], patches @ slopes[:, None, :, None]
        powers, slopes = _powers(azimuth)
        jacobian = np.zeros((count, size, 3))
        mean = (by_power[..., 0] @ powers[..., None])[..., 0]
        jacobian[:, :, 0] = (by_power[..., 0] @ slopes[..., None])[..., 0]
        jacobian[:, :, 1] = (rising[..., 0] @ powers[..., None])[..., 0]
        corners, shares = _corners(at, azimuth, elevation)
        spread = self._covariances[corners + AZIMUTHS * ELEVATIONS * classes[:, None]]
        covariance = (shares[:, None] @ spread)[:, 0].reshape(count, size, size)
        return Prediction(mean, covariance, jacobian)

    def in_coverage(self, classes: Index, viewpoints: Viewpoints) -> Flags:
        """(B,) whether a training view of the class lies near this direction."""
        corners, shares = _corners(*_cells(viewpoints))
        nearest = corners[np.arange(len(corners)), np.argmax(shares, axis=1)]
        return np.asarray(
            self._cosines[nearest + AZIMUTHS * ELEVATIONS * classes] >= np.cos(self._coverage_rad[classes])
        )


def fitted_classes(
    class_names: tuple[str, ...], feature_names: tuple[str, ...], fits: Sequence[ClassFit]
) -> GaussianProcessModel | SphericalProcessModel:
    """Class models over azimuth, or over both angles where the fits have elevations."""
    if any(fit.elevation_rad is not None for fit in fits):
        return SphericalProcessModel(class_names, feature_names, fits)
    return GaussianProcessModel(class_names, feature_names, fits)


def _cells(viewpoints: Viewpoints) -> tuple[Index, Array, Array]:
    """(B,) flat cell indices of the table, and positions 0..1 within the cells along azimuth and elevation."""
    around, azimuth = split_at(viewpoints.azimuth_rad / STEP_RAD)
    height = np.clip((viewpoints.elevation_rad + 0.5 * np.pi) / STEP_RAD, 0.0, ELEVATIONS - 1.0)
    row = np.minimum(np.floor(height), ELEVATIONS - 2.0)
    return row.astype(np.int64) * AZIMUTHS + around % AZIMUTHS, azimuth, height - row


def _corners(at: Index, azimuth: Array, elevation: Array) -> tuple[Index, Array]:
    """(B, 4) indices of the grid directions around each position in a cell, and their bilinear weights."""
    row, column = np.divmod(at, AZIMUTHS)
    beside = row * AZIMUTHS + (column + 1) % AZIMUTHS
    corners = np.stack([at, beside, at + AZIMUTHS, beside + AZIMUTHS], axis=1)
    sides, heights = np.stack([1.0 - azimuth, azimuth], axis=1), np.stack([1.0 - elevation, elevation], axis=1)
    return corners, (heights[:, :, None] * sides[:, None, :]).reshape(-1, 4)


def _powers(t: Array) -> tuple[Array, Array]:
    """(B, 4) powers of positions in a cell, and their derivatives per radian."""
    one, square = np.ones_like(t), t * t
    slopes = np.stack([np.zeros_like(t), one, 2.0 * t, 3.0 * square], axis=1)
    return np.stack([one, t, square, square * t], axis=1), slopes / STEP_RAD


def _patches(table: SphericalTable) -> Array:
    """(cells, F, 4, 4) bicubic coefficients by powers of azimuth and elevation in each cell."""
    size = table.mean.shape[2]
    scales = 1.0, STEP_RAD, STEP_RAD, STEP_RAD**2
    values, by_azimuth, by_elevation, twist = (
        scale * getattr(table, item.name) for scale, item in zip(scales, fields(table), strict=False)
    )
    ends = np.empty((ELEVATIONS - 1, AZIMUTHS, size, 4, 4))
    for side in range(2):
        for top in range(2):
            at = [
                np.roll(own, -side, axis=1)[top : ELEVATIONS - 1 + top]
                for own in (values, by_elevation, by_azimuth, twist)
            ]
            ends[..., side, top], ends[..., side, 2 + top] = at[0], at[1]
            ends[..., 2 + side, top], ends[..., 2 + side, 2 + top] = at[2], at[3]
    return np.asarray(HERMITE @ ends.reshape(-1, size, 4, 4) @ HERMITE.T)


def _covariances(fit: ClassFit, table: SphericalTable) -> Array:
    """(grid, F F) covariance of single views: noise plus posterior variance of the mean."""
    size = table.mean.shape[2]
    whole = fit.noise_covariance + table.variance[..., None] * np.eye(size)
    return np.asarray(whole.reshape(-1, size * size))


def _nearest(fit: ClassFit) -> Array:
    """(grid,) cosine of the angle from each direction of the grid to the nearest training view."""
    return np.asarray(grid_directions().cosines(fit.directions).max(axis=1))
