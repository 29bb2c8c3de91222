"""Whether any class model knows a measurement: the viewpoint is not known to who only sees the picture."""

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.chi_squared import chi_squared_quantile
from semantic_slam.viewpoint.model import ViewpointModel, all_around

NUM_AZIMUTHS = 72
QUANTILE = 0.999
"""Share of the views that the class models describe which counts as known."""


class KnownViews:
    """What C class models predict in the directions that they were fitted on."""

    def __init__(self, model: ViewpointModel) -> None:
        classes, viewpoints = all_around(model, NUM_AZIMUTHS)
        covered = model.in_coverage(classes, viewpoints)
        prediction = model.predict(classes, viewpoints)
        self.num_features = model.num_features
        self._mean, self._covariance = prediction.mean[covered], prediction.covariance[covered]
        self._limit = float(chi_squared_quantile(QUANTILE, model.num_features))

    def explain(self, feature: Array, feature_covariance: Array) -> bool:
        """Whether a feature (F,) with its dropout covariance (F, F) is one that some class shows in some direction."""
        residual = feature - self._mean
        whitened = np.linalg.solve(self._covariance + feature_covariance, residual[..., None])[..., 0]
        return bool(np.any((residual * whitened).sum(axis=-1) <= self._limit))
