"""Outlier probability of views whose scores no class explains."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.class_models.kind import class_model_kind
from semantic_slam.class_models.viewpoint_models import load_model
from semantic_slam.configuration import SemanticModelConfiguration
from semantic_slam.geometry.arrays import Array
from semantic_slam.perception.measurement import SemanticMeasurements
from semantic_slam.viewpoint.outliers import OutlierScores


@dataclass(frozen=True, kw_only=True)
class OutlierViews:
    """Outlier component e p_out of the view density (1 - e) p + e p_out used by a run."""

    scores: OutlierScores
    tempering: float

    @classmethod
    def of(cls, settings: SemanticModelConfiguration) -> "OutlierViews | None":
        """From a run's configuration; None where views cannot be outliers or are not scores."""
        kind = class_model_kind(settings)
        model = load_model(settings) if kind.has_factors else None
        if model is None or settings.outlier_share <= 0.0:
            return None
        tempering = settings.likelihood_tempering if kind.repeats_errors else 1.0
        return cls(scores=OutlierScores.of(model, settings.outlier_share), tempering=tempering)

    def probability(self, measured: SemanticMeasurements, detection_id: int, log_likelihood: float) -> float:
        """Outlier probability of a detection, from its log density under the object's class; NaN where unknown."""
        rows = np.flatnonzero(measured.detection_ids == detection_id)
        if not len(rows) or not np.isfinite(log_likelihood):
            return float("nan")
        row = slice(int(rows[0]), int(rows[0]) + 1)
        density: Array = self.scores.log_density(measured.features[row], measured.feature_covariances[row])
        log_outlier = np.log(self.scores.share) + float(density[0]) / self.tempering
        return float(np.exp(min(log_outlier - log_likelihood, 0.0)))
