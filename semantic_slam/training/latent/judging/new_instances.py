"""How much less a model knows of objects that it was not fitted to: trained instances left out in turn.

Everything is learned anew without the ones that are left out, features too: they would know what they were learned to
tell apart. The descriptors of those left out come from a few of their views, as those of a new object do.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.latent.latent_model import LatentModel
from semantic_slam.training.latent.judging.evaluation import descriptors_from_views, squared_in_doubt
from semantic_slam.training.latent.views.feature_views import FeatureViews

FOLDS = 3
VIEWS_OF_NEW = 3
"""Views of a left-out object that its descriptor is inferred from."""
LEAST_INSTANCES = 2 * FOLDS
"""Fewer tell nothing of objects that are new."""
ROUNDS = 4
"""How sure the descriptors are changes with the factor."""


@dataclass(frozen=True)
class LeftOut:
    """A calibrated model that has not seen some instances, and views of them as its features have them."""

    model: LatentModel
    views: FeatureViews


def folds_of(names: Sequence[str]) -> list[tuple[str, ...]]:
    """The instances to leave out, fold by fold; none where there are too few instances."""
    if len(names) < LEAST_INSTANCES:
        return []
    return [tuple(names[fold::FOLDS]) for fold in range(FOLDS)]


def new_factor(parts: Sequence[LeftOut]) -> float | None:
    """What sigma is multiplied by, so that the azimuth of left-out instances has NEES 1; None without any parts."""
    if not parts:
        return None
    factor = 1.0
    for _ in range(ROUNDS):
        squared = np.concatenate([_squared_errors(part, factor) for part in parts])
        factor *= float(np.sqrt(squared.mean()))
    return factor


def _squared_errors(part: LeftOut, factor: float) -> Array:
    """(N,) squared azimuth errors over their variances; the same views tell the descriptors in every round."""
    model = replace(part.model, new_factor=factor).on_new_instances()
    inferred = descriptors_from_views(model, part.views, VIEWS_OF_NEW, np.random.default_rng(31))
    return squared_in_doubt(model, inferred)
