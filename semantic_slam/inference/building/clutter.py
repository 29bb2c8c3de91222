"""The clutter (false alarm) model of a run: densities of position and scores of a detection of no object."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from semantic_slam.class_models.kind import class_model_kind
from semantic_slam.configuration import Configuration
from semantic_slam.geometry.arrays import Array
from semantic_slam.inference.building.run_models import RunModels
from semantic_slam.inference.models.clutter import Clutter, EvenClutter, EvenSpatialClutter
from semantic_slam.inference.reference import EvenWords
from semantic_slam.viewpoint.outliers import OutlierScores

FEATURE = "feature", "feature_covariance"
"""Fields of a detection that hold its semantic feature."""


def clutter_of(configuration: Configuration, models: RunModels) -> Clutter | None:
    """The clutter model; None for class models whose view likelihoods have no outlier floor.

    Without a floor, clutter would explain away unlikely views: this concerns views with shared errors, and descriptors.
    """
    kind = class_model_kind(configuration.semantic_model)
    clutter = EvenSpatialClutter if configuration.is_spatial else EvenClutter
    if models.labels is not None:
        even = EvenWords(models.labels.num_words).log_density
        return clutter.of(configuration.open_world, lambda seen: np.array([even([own]) for own in seen]))
    if kind.sees_places_alone:
        return clutter.of(configuration.open_world, None)
    if models.viewpoint is None or not kind.has_factors:
        return None
    broad = OutlierScores.of(models.viewpoint, 0.0)

    def log_scores(detections: Sequence[Any]) -> Array:
        features, covariances = ([getattr(own, name) for own in detections] for name in FEATURE)
        return broad.log_density(np.array(features), np.array(covariances)) / models.tempering

    return clutter.of(configuration.open_world, log_scores)
