"""Novelty test: whether any class model explains a feature from any viewpoint, which an image alone leaves unknown."""

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.chi_squared import chi_squared_quantile
from semantic_slam.viewpoint.model import ViewpointModel, all_around

NUM_AZIMUTHS = 72
QUANTILE = 0.999
"""Share of the views described by the class models that must count as known (chi-squared gate)."""


class KnownViews:
    """Predictions of C class models in the directions that they were fitted on."""

    def __init__(self, model: ViewpointModel) -> None:
        classes, viewpoints = all_around(model, NUM_AZIMUTHS)
        covered = model.in_coverage(classes, viewpoints)
        prediction = model.predict(classes, viewpoints)
        self.num_features = model.num_features
        self._mean, self._covariance = prediction.mean[covered], prediction.covariance[covered]
        self._limit = float(chi_squared_quantile(QUANTILE, model.num_features))

    def explain(self, feature: Array, feature_covariance: Array) -> bool:
        """Whether some class in some direction explains a feature (F,) with its dropout covariance (F, F)."""
        residual = feature - self._mean
        whitened = np.linalg.solve(self._covariance + feature_covariance, residual[..., None])[..., 0]
        return bool(np.any((residual * whitened).sum(axis=-1) <= self._limit))
