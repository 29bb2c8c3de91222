"""Sigma from calibration views, and how much of it a factor graph may believe."""

from dataclasses import replace

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.latent.latent_model import FeatureNoise, LatentModel
from semantic_slam.training.latent.judging.evaluation import azimuth_nees, own_descriptors
from semantic_slam.training.latent.views.feature_views import FeatureViews

LARGEST_SQUARED = 10.83
"""Normalised squared error that one of a thousand views exceeds: beyond it an ascent has ended at another peak. Such a
view counts no more than this, or it alone would widen all others."""
ROUNDS = 20


def feature_noise(model: LatentModel, views: FeatureViews) -> FeatureNoise:
    """Sigma of the ``views``' residuals, tempered so that the azimuth inferred from them has NEES 1.

    The ascent that infers the azimuth does not depend on a common factor of sigma, its variance goes with the square.
    """
    descriptors = own_descriptors(model, views)
    residuals = views.features - model.mean(views.viewpoints, descriptors)
    sigma = np.sqrt((residuals**2).mean(axis=0))
    return FeatureNoise(sigma, float(np.sqrt(mean_squared(azimuth_nees(model, views, descriptors, sigma)))))


def mean_squared(squared: Array) -> float:
    """Mean of (N,) squared errors, none counted for more than LARGEST_SQUARED times the mean."""
    mean = float(squared.mean())
    for _ in range(ROUNDS):
        mean = float(np.minimum(squared, LARGEST_SQUARED * mean).mean())
    return mean


def calibrated(model: LatentModel, in_rooms: FeatureViews, on_turntable: FeatureViews) -> LatentModel:
    """The model with the noise of calibration views in rooms, and that of plain ones."""
    return replace(model, noise=feature_noise(model, in_rooms), turntable_noise=feature_noise(model, on_turntable))
