"""Pairs of views of one instance: what the model over changes of viewpoint is fitted to and judged on."""

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.latent.change_model import ChangeModel
from semantic_slam.training.latent.views.feature_views import FeatureViews

PAIRS = 600
"""Number of pairs of views that are drawn to judge a model by."""
NEAR_RAD, LEAST_TURN_RAD = float(np.deg2rad(45.0)), float(np.deg2rad(1.0))
"""Azimuths of a near pair differ by no more; of any pair that is judged, by no less."""


def draw_pairs(
    views: FeatureViews, count: int, largest_rad: float, generator: np.random.Generator
) -> tuple[Index, Index]:
    """Rows of two views each of one instance, whose azimuths differ by ``largest_rad`` at most; up to ``count``."""
    order = np.argsort(views.instance, kind="stable")
    starts = np.searchsorted(views.instance[order], np.arange(len(views.names) + 1))
    first = generator.integers(len(views), size=4 * count)
    own = views.instance[first]
    second = order[generator.integers(starts[own], starts[own + 1])]
    near = np.abs(changes(views, first, second)[:, 0]) <= largest_rad
    return first[near][:count], second[near][:count]


def changes(views: FeatureViews, first: Index, second: Index) -> Array:
    """(B, 2) change of azimuth, within half a turn, and of elevation from one view to another."""
    azimuth, elevation = views.viewpoints.azimuth_rad, views.viewpoints.elevation_rad
    turn = wrap_angle(azimuth[second] - azimuth[first])
    return np.stack([turn, elevation[second] - elevation[first]], axis=1)


def change_peaks(model: ChangeModel, views: FeatureViews, first: Index, second: Index) -> Array:
    """(B,) error [rad] of the change of azimuth at which the second view's likelihood peaks, all around."""
    turns = np.deg2rad(np.arange(-180.0, 180.0, 3.0))
    truth = changes(views, first, second)
    score = np.empty((len(first), len(turns)))
    for column, turn in enumerate(turns):
        tried = np.column_stack([np.full(len(first), turn), truth[:, 1]])
        score[:, column] = model.predict(views.features[first], tried).log_likelihood(views.features[second])
    return wrap_angle(turns[score.argmax(axis=1)] - truth[:, 0])


def changes_found(model: ChangeModel, views: FeatureViews, generator: np.random.Generator) -> dict[str, float]:
    """Share of pairs of views from different azimuths whose change is found within 10 degrees: near ones, and all.

    A share of which there is no pair is left out: views 60 degrees apart have none that are near.
    """
    shares = {}
    for name, largest_rad in (("change_peak_within_10deg_near", NEAR_RAD), ("change_peak_within_10deg", np.pi)):
        first, second = draw_pairs(views, PAIRS, largest_rad, generator)
        apart = np.abs(changes(views, first, second)[:, 0]) > LEAST_TURN_RAD
        if apart.any():
            errors = np.abs(change_peaks(model, views, first[apart], second[apart]))
            shares[name] = float((errors < np.deg2rad(10.0)).mean())
    return shares
