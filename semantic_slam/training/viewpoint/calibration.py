"""How honest a fitted model is: residuals of views that it has not seen."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.training.viewpoint.regression import fit_class, gaussian_nll, whitened_squared
from semantic_slam.training.viewpoint.samples import FOLDS, ClassSamples
from semantic_slam.viewpoint.model import ViewpointModel, Viewpoints
from semantic_slam.viewpoint.spherical_process import fitted_classes


@dataclass(frozen=True)
class Residuals:
    """Whitened residuals of N measurements against the model of their true class."""

    squared: Array  # (N,) F on average when calibrated
    standardised: Array  # (N, F) per component, unit variance when calibrated
    nll: float  # nats

    def summary(self) -> dict[str, float]:
        """The numbers of a report."""
        return {
            "mean_squared_whitened_residual": float(self.squared.mean()),
            "fraction_within_1_sigma": float(np.mean(np.abs(self.standardised) < 1.0)),
            "fraction_within_2_sigma": float(np.mean(np.abs(self.standardised) < 2.0)),
            "nll": self.nll,
        }


def residuals(model: ViewpointModel, class_index: int, samples: ClassSamples) -> Residuals:
    """Residuals of samples of one class; the dropout covariance of each measurement is part of what is expected."""
    repeats = samples.features.shape[1]
    size = model.num_features
    azimuth = np.repeat(samples.azimuth_rad, repeats)
    told = samples.elevation_rad
    elevation = np.zeros_like(azimuth) if told is None else np.repeat(told, repeats)
    viewpoints = Viewpoints(azimuth, elevation, np.ones_like(azimuth))
    prediction = model.predict(np.full(azimuth.size, class_index), viewpoints)
    difference = samples.features.reshape(-1, size) - prediction.mean
    covariance = prediction.covariance + samples.feature_covariances.reshape(-1, size, size)
    sigma = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    return Residuals(whitened_squared(difference, covariance), difference / sigma, gaussian_nll(difference, covariance))


def left_out_residuals(data: ClassSamples, feature_names: tuple[str, ...]) -> Residuals:
    """Residuals of views left out of the fit, ``FOLDS`` fits in turn, fold by fold; at least as many views."""
    fold = data.folds
    parts = []
    for left_out in range(FOLDS):
        model = fitted_classes(("class",), feature_names, [fit_class(data.select(fold != left_out))])
        parts.append(residuals(model, 0, data.select(fold == left_out)))
    return Residuals(
        np.concatenate([part.squared for part in parts]),
        np.concatenate([part.standardised for part in parts]),
        float(np.average([part.nll for part in parts], weights=[part.squared.size for part in parts])),
    )


def report_of(samples: Mapping[str, ClassSamples], left_out: Mapping[str, Residuals]) -> dict[str, Any]:
    """For each class its coverage and the figures of its residuals of views left out of the fit."""
    return {
        name: {
            "coverage": coverage(own.azimuth_rad) | _heights(own.elevation_rad),
            "left_out": own.left_out,
            **left_out[name].summary(),
        }
        for name, own in samples.items()
    }


def _heights(elevation_rad: Array | None) -> dict[str, list[float]]:
    """Elevations of the views, where these are told apart."""
    if elevation_rad is None:
        return {}
    return {"heights_deg": np.unique(np.round(np.rad2deg(elevation_rad))).tolist()}


def coverage(azimuth_rad: Array) -> dict[str, float]:
    """Number of views and the widest angle without one."""
    ordered = np.sort(azimuth_rad % (2.0 * np.pi))
    gaps = np.diff(np.append(ordered, ordered[0] + 2.0 * np.pi))
    return {"views": float(azimuth_rad.size), "widest_gap_deg": float(np.rad2deg(gaps.max()))}
