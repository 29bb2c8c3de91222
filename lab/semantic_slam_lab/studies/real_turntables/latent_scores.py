"""What a latent model tells of photographs that it was not fitted to: azimuth, instance, new objects."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.geometry.log_space import log_sum_exp
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.latent.latent_model import LatentModel
from semantic_slam.training.latent.judging import evaluation
from semantic_slam.training.latent.judging.estimation import azimuth_raster
from semantic_slam.training.latent.views.feature_views import FeatureViews
from semantic_slam_lab.repetitions import keyed_generator
from semantic_slam_lab.studies.real_turntables.photographs import Photographs

NEAR_RAD = float(np.deg2rad(10.0))
TOLD_SHARE = 0.95
"""Share of held-out views with their nearest training view within NEAR_RAD, from which an azimuth can be told."""
GROUP, GROUP_SIGMA_RAD = 5, float(np.deg2rad(10.0))
VIEWS_OF_NEW = 3
LOTS = 200
NAME = "real_turntables"


@dataclass(frozen=True)
class ObjectScores:
    """One object's held-out views."""

    nearest_within_10deg: float  # what a nearest neighbour among the training views tells
    peak_within_10deg: float
    entropy: float  # nats, of the likelihood over the azimuth, log 180 where it is flat
    nees: float  # mean over the views

    @property
    def can_be_told(self) -> bool:
        return self.nearest_within_10deg >= TOLD_SHARE


def told_by_nearest(photographs: Photographs, layout: Array, train: Index, test: Index) -> dict[str, float]:
    """Share of every object's ``test`` views whose nearest of its ``train`` views, as the trunk sees them, is near."""
    found = {}
    for name in photographs.names:
        seen, asked = (np.intersect1d(photographs.of(name), rows) for rows in (train, test))
        if not len(seen) or not len(asked):
            continue
        products = layout[asked] @ layout[seen].T
        distance = np.square(layout[seen]).sum(axis=1) - 2.0 * products
        error = wrap_angle(photographs.azimuth_rad[seen[distance.argmin(axis=1)]] - photographs.azimuth_rad[asked])
        found[name] = float((np.abs(error) <= NEAR_RAD + 1e-9).mean())
    return found


def by_object(model: LatentModel, views: FeatureViews, nearest: dict[str, float]) -> dict[str, ObjectScores]:
    """Scores of every known object."""
    descriptors = evaluation.own_descriptors(model, views)
    peaks = np.abs(evaluation.azimuth_peaks(model, views, descriptors)) <= NEAR_RAD
    raster = azimuth_raster(model, views.viewpoints, descriptors, views.features, evaluation.RASTER_RAD)
    logs = raster - log_sum_exp(raster, axis=1, keepdims=True)
    entropy = -(np.exp(logs) * logs).sum(axis=1)
    squared = evaluation.azimuth_nees(model, views, descriptors)
    found = {}
    for index, name in enumerate(views.names):
        own = views.instance == index
        if own.any():
            numbers = (float(values[own].mean()) for values in (peaks, entropy, squared))
            found[name] = ObjectScores(nearest[name], *numbers)
    return found


def of_known(model: LatentModel, views: FeatureViews, scores: dict[str, ObjectScores], seed: int) -> dict[str, Any]:
    """Numbers over the objects whose azimuth can be told, and which instance views are of."""
    told = {name: own for name, own in scores.items() if own.can_be_told}
    rows = np.isin(np.array(views.names)[views.instance], list(told))
    nees = np.array([own.nees for own in told.values()])
    groups = evaluation.identification_of_groups(
        model, views, GROUP, GROUP_SIGMA_RAD, keyed_generator(NAME, "groups", seed)
    )
    return {
        "objects_told": len(told),
        "peak_within_10deg": float(np.mean([own.peak_within_10deg for own in told.values()])),
        "nees": float(nees.mean()),
        "nees_band": list(evaluation.consistency(nees).band),  # of one view per object
        "nees_one_view_in_band": _lots(model, views.chosen(rows), list(told), seed),
        "instance_1_view": float(evaluation.identification(model, views).mean()),
        "instance_5_views": float(groups.mean()),
        "temper": model.noise.temper,
        "factor_of_new": model.new_factor,
    }


def _lots(model: LatentModel, views: FeatureViews, told: list[str], seed: int) -> float:
    """Share of lots inside of the squared errors of every told object's views."""
    squared = evaluation.azimuth_nees(model, views, evaluation.own_descriptors(model, views))
    of_object = [squared[views.instance == views.names.index(name)] for name in told]
    return share_inside(of_object, keyed_generator(NAME, "lots", seed))


def share_inside(of_object: Sequence[Array], generator: np.random.Generator) -> float:
    """Share of LOTS draws of one view per object whose NEES lies in the 95 % band of as many independent values.

    ``of_object``: (V,) squared errors over their variances of each object's views. The mean over all views scatters
    far less than that band is wide, so that it lies inside even where it is half as large again as it should be.
    """
    lots = np.stack([generator.choice(own, LOTS) for own in of_object], axis=1)
    return float(np.mean([evaluation.consistency(lot).consistent for lot in lots]))


def of_new(model: LatentModel, views: FeatureViews, seed: int) -> dict[str, float]:
    """Numbers of objects that were held out, descriptors from three views; ``widened`` by what the decoder lacks."""
    found = {}
    for name, own in (("", model), ("_widened", model.on_new_instances())):
        inferred = evaluation.descriptors_from_views(own, views, VIEWS_OF_NEW, keyed_generator(NAME, "new", seed))
        squared = evaluation.squared_in_doubt(own, inferred)
        peaks = np.abs(evaluation.azimuth_peaks(own, inferred.views, inferred.descriptors))
        found[f"new_nees{name}"] = float(squared.mean())
        found[f"new_within_two_sigma{name}"] = float((squared < 4.0).mean())
        found[f"new_peak_within_10deg{name}"] = float((peaks <= NEAR_RAD).mean())
    return {**found, "new_objects": float(len(views.names))}
