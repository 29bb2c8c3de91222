"""A detector's class scores as the semantic feature, where no classifier has measured one."""

from dataclasses import dataclass, replace

import numpy as np

from semantic_slam.errors import InputError, shortened
from semantic_slam.geometry.arrays import Array
from semantic_slam.perception.measurement import SemanticMeasurements

REMEDY = "or set semantic_model.kind: none"


@dataclass(frozen=True)
class FeatureReader:
    """Provides the features that the class models need: ``num_features`` of them, 0 for none.

    ``names`` (F,) or empty: classes whose scores serve as features if no classifier has measured any.
    """

    num_features: int = 0
    names: tuple[str, ...] = ()

    def with_features(self, measurements: SemanticMeasurements) -> SemanticMeasurements:
        """The measurements, with vectors or class scores as their features where they have none. Raises InputError."""
        num_given = measurements.features.shape[1]
        if not self.num_features or not len(measurements):
            return measurements
        if num_given not in (0, self.num_features):
            raise InputError(
                f"the classifier gives {num_given} feature components but the class models were"
                f" fitted on {self.num_features}; fit viewpoint models for it or set semantic_model.kind: none"
            )
        if measurements.feature_covariances.shape[1:] != (num_given, num_given):
            raise InputError(
                f"measurements: feature_covariances are not those of their {num_given} features;"
                " give one for each pair of features, and features beside them"
            )
        if num_given:
            self._check_names(measurements)
            return measurements
        features = self._told(measurements)
        return replace(
            measurements, features=features, feature_covariances=np.zeros((*features.shape, self.num_features))
        )

    def _check_names(self, measurements: SemanticMeasurements) -> None:
        """Raises InputError if a classifier's scores are of other classes than those that the models were fitted on."""
        is_classified = measurements.class_probability_samples.shape[1] > 0
        if is_classified and self.names and measurements.class_names != self.names:
            raise InputError(
                f"the classifier gives scores of {shortened(measurements.class_names)} but the class models were"
                f" fitted on those of {shortened(self.names)}; fit viewpoint models for it {REMEDY}"
            )

    def _told(self, measurements: SemanticMeasurements) -> Array:
        """(D, F) vectors of appearance where the class models were fitted on such, else class scores."""
        told = measurements.embeddings
        if told.shape[1] == self.num_features and not self.names and np.isfinite(told).all():
            return told
        return score_features(measurements, self.names)


def score_features(measurements: SemanticMeasurements, names: tuple[str, ...]) -> Array:
    """(D, F) class scores in the order of the (F,) ``names`` of the class models' features.

    The scores must be those of the detector that the models were fitted on. Raises InputError.
    """
    if not names:
        raise InputError(f"the class models do not name their features; give features instead of scores, {REMEDY}")
    given = measurements.class_names
    wanted = f"the class models know {', '.join(names)}"
    if not given:
        raise InputError(f"detections have no class scores; {wanted}: give the scores of these, {REMEDY}")
    unknown = [name for name in given if name not in names]
    if unknown:
        raise InputError(f"class score '{unknown[0]}' is of an unknown class; {wanted}: correct the name, {REMEDY}")
    missing = [name for name in names if name not in given]
    scores = measurements.class_scores[:, [given.index(name) for name in names if name in given]]
    if missing or np.isnan(scores).any():
        raise InputError(f"detections without a score for every class; {wanted}: give the scores of these, {REMEDY}")
    return np.asarray(scores)
