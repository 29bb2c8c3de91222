"""Viewpoint-dependent class models P(z_sem | c, viewpoint) = N(h_c, Sigma_c), Eq. 4.2."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from semantic_slam.geometry.arrays import Array, Flags, Index
from semantic_slam.geometry.small_matrices import cholesky, forward


@dataclass(frozen=True)
class Viewpoints:
    """B viewpoints: the camera's position in the object's frame, in spherical coordinates."""

    azimuth_rad: Array  # (B,) about the object's z axis, from its x axis (its front)
    elevation_rad: Array  # (B,)
    range_m: Array  # (B,)


@dataclass(frozen=True)
class Prediction:
    """Distribution of the semantic feature at B viewpoints; F components."""

    mean: Array  # (B, F)
    covariance: Array  # (B, F, F); NumPy's read-only view of one matrix where it is the same everywhere
    mean_jacobian: Array  # (B, F, 3) with respect to azimuth, elevation [1/rad] and range [1/m]


class ViewpointModel(Protocol):
    """Interface of a viewpoint model: C classes, F feature components. A new one also subclasses the contract test."""

    @property
    def class_names(self) -> tuple[str, ...]:
        """(C,) names of the classes."""

    @property
    def num_features(self) -> int:
        """Number of feature components F, which the classifier must match."""

    def predict(self, classes: Index, viewpoints: Viewpoints) -> Prediction:
        """Prediction for class ``classes[b]`` at viewpoint b; (B,) class indices."""

    def in_coverage(self, classes: Index, viewpoints: Viewpoints) -> Flags:
        """(B,) whether the model was fitted on views near this one."""


def feature_names(model: ViewpointModel) -> tuple[str, ...]:
    """(F,) feature names: those of the model, or its class names; () where the number does not match."""
    names: tuple[str, ...] = getattr(model, "feature_names", model.class_names)
    return names if len(names) == model.num_features else ()


def all_around(model: ViewpointModel, count: int) -> tuple[Index, Viewpoints]:
    """Every class from ``count`` azimuths at 1 m range, at each fitted elevation, or at zero elevation."""
    heights: tuple[float, ...] = getattr(model, "elevations_rad", (0.0,))
    names = len(model.class_names)
    azimuth = np.tile(2.0 * np.pi / count * np.arange(count), names * len(heights))
    elevation = np.tile(np.repeat(heights, count), names)
    return np.repeat(np.arange(names), count * len(heights)), Viewpoints(azimuth, elevation, np.ones_like(azimuth))


def log_likelihood(model: ViewpointModel, feature: Array, feature_covariance: Array, viewpoint: Viewpoints) -> Array:
    """(C,) log N(feature; h_c, Sigma_c + feature_covariance) at one viewpoint, in nats.

    ``feature`` is (F,) and ``feature_covariance`` (F, F): the dropout samples' mean and covariance.
    """
    count = len(model.class_names)
    repeated = Viewpoints(
        *(np.repeat(value, count) for value in (viewpoint.azimuth_rad, viewpoint.elevation_rad, viewpoint.range_m))
    )
    prediction = model.predict(np.arange(count), repeated)
    return log_density(feature - prediction.mean, prediction.covariance + feature_covariance)


def log_density(residual: Array, covariance: Array) -> Array:
    """(B,) log N(residual; 0, covariance) [nats] of (B, F) residuals and (B, F, F) covariances."""
    root = cholesky(covariance)
    squared = (forward(root, residual[..., None]) ** 2).sum(axis=(-2, -1))
    logdet = 2.0 * np.log(np.diagonal(root, axis1=-2, axis2=-1)).sum(axis=-1)
    return np.asarray(-0.5 * (squared + logdet + residual.shape[-1] * np.log(2.0 * np.pi)))
