"""Loading of the configured label model: generic defaults, or fitted to runs of this detector."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from semantic_slam.class_models.kind import ClassModelKind, class_model_kind
from semantic_slam.configuration import OpenWorldConfiguration, SemanticModelConfiguration
from semantic_slam.errors import InputError
from semantic_slam.model_files import kind_of
from semantic_slam.viewpoint.embeddings.store import FORMAT as VECTORS
from semantic_slam.viewpoint.labels.confusion import Confusion
from semantic_slam.viewpoint.labels.model import NONE_OF_THESE, LabelModel
from semantic_slam.viewpoint.labels.settings import LabelSettings
from semantic_slam.viewpoint.labels.store import FittedLabels, read_labels
from semantic_slam.viewpoint.labels.vocabulary import with_vocabulary


def load_label_model(settings: SemanticModelConfiguration, bag_sha256: str = "") -> LabelModel | None:
    """Load the label model, or None where labels are not used. Raises InputError.

    ``bag_sha256`` is the digest of the bag to run: if the models were fitted to it, variants fitted without it are used
    (leave-one-out).
    """
    load = class_model_kind(settings).labels
    return load(settings, bag_sha256) if load is not None else None


def fitted_labels(settings: SemanticModelConfiguration) -> FittedLabels | None:
    """Labels' part of the configured file; None without a file, where it is of vectors, or where labels are not used.

    Raises InputError.
    """
    kind = class_model_kind(settings)
    if not settings.path or kind.labels is None:
        return None
    is_of_vectors = kind.embeddings is not None and kind_of(Path(settings.path)) == VECTORS.kind
    return None if is_of_vectors else read_labels(Path(settings.path))


def with_fitted_detection(
    world: OpenWorldConfiguration, settings: SemanticModelConfiguration, bag_sha256: str
) -> OpenWorldConfiguration:
    """``world`` with the fitted detector's detection statistics, where the configuration has none to be inferred.

    Raises InputError.
    """
    fitted = fitted_labels(settings)
    inferred = world.detection_probabilities, world.detection_half_ranges_m, world.miss_persistences
    if fitted is None or any(inferred) or world.detection_by_direction:
        return world
    told = fitted.detection_of(bag_sha256)
    return replace(
        world,
        detection_probabilities=_known(told.probability),
        detection_half_ranges_m=_known(told.half_range_m),
        detection_by_direction=told.over(world.field_of_view_rad),
        miss_persistences=_known(told.persistence),
    )


def _known(value: float | None) -> tuple[float, ...]:
    return () if value is None else (value,)


def label_model(settings: SemanticModelConfiguration, bag_sha256: str) -> LabelModel:
    """Label model from the configuration parameters, or from the configured file. Raises InputError."""
    labels = settings.labels
    if not labels:
        other = "none" if class_model_kind(settings).embeddings is None else "embedding"
        raise InputError(
            f"semantic_model.kind: {settings.kind}, but nothing tells which labels the detector has; list them in"
            f" semantic_model.labels, or set semantic_model.kind: {other}"
        )
    faults = [label for label in labels if not label or labels.count(label) > 1 or label == NONE_OF_THESE]
    if faults:
        raise InputError(
            f"semantic_model.labels: '{faults[0]}' is there twice, empty or the name of what no label means; correct it"
        )
    if not settings.repeat_shares or not 0.0 <= min(settings.repeat_shares) <= max(settings.repeat_shares) < 1.0:
        raise InputError("semantic_model.repeat_shares must be in [0, 1), one at least; correct them")
    if not settings.count_factors or min(settings.count_factors) <= 0.0:
        raise InputError("semantic_model.count_factors must be above 0, one at least; correct them")
    if not settings.score_powers or min(settings.score_powers) < 0.0:
        raise InputError("semantic_model.score_powers must not be below 0, one at least; correct them")
    fitted = fitted_labels(settings)
    if fitted is not None:
        return with_vocabulary(fitted.model(bag_sha256), labels)
    return LabelModel(
        labels=labels,
        settings=LabelSettings.grid(
            settings.repeat_shares,
            (settings.repeat_rad,),
            settings.count_factors,
            score_powers=settings.score_powers,
        ),
        confusions=(
            Confusion.symmetric(len(labels), settings.label_accuracy, settings.label_counts, settings.outlier_share),
        ),
        class_shares=np.full(len(labels) + 1, 1.0 / (len(labels) + 1)),
    )


DETECTOR = ClassModelKind(
    labels=label_model, semantics="detector_labels", carried="detector_labels", has_factors=False, repeats_errors=False
)
"""Class models from the detector's own labels and scores, without a classification network."""
