"""What a latent model is worth on views that it was not trained on."""

from dataclasses import dataclass

import numpy as np

from semantic_slam.geometry.arrays import Array
from semantic_slam.geometry.chi_squared import chi_squared_quantile
from semantic_slam.geometry.log_space import log_sum_exp
from semantic_slam.geometry.pose import wrap_angle
from semantic_slam.geometry.rows import take
from semantic_slam.latent.latent_model import LatentModel
from semantic_slam.training.latent.judging.estimation import (
    DescriptorEstimate,
    ascend_azimuth,
    azimuth_in_doubt,
    azimuth_raster,
    infer_descriptors,
)
from semantic_slam.training.latent.views.feature_views import FeatureViews, repeated, turned
from semantic_slam.viewpoint.model import Viewpoints

RASTER_RAD = np.deg2rad(np.arange(-180.0, 180.0, 2.0))


def own_descriptors(model: LatentModel, views: FeatureViews) -> Array:
    """(N, L) descriptor of each view's instance as it was learned; views must be of trained instances."""
    rows = [model.instances.names.index(name) for name in views.names]
    return np.asarray(model.instances.descriptors[np.array(rows)[views.instance]])


def azimuth_peaks(model: LatentModel, views: FeatureViews, descriptors: Array) -> Array:
    """(N,) error [rad] of the azimuth at which each view's likelihood peaks, looked for all around the object."""
    raster = azimuth_raster(model, views.viewpoints, descriptors, views.features, RASTER_RAD)
    start = turned(views.viewpoints, RASTER_RAD[raster.argmax(axis=1)])
    peak = ascend_azimuth(model, start, descriptors, views.features).azimuth_rad
    return wrap_angle(peak - views.viewpoints.azimuth_rad)


@dataclass(frozen=True)
class Ascents:
    """Errors [rad] in azimuth before and after, (N,) each."""

    start_rad: Array
    end_rad: Array

    @property
    def improved_fraction(self) -> float:
        return float((np.abs(self.end_rad) < np.abs(self.start_rad)).mean())

    @property
    def median_error_deg(self) -> float:
        return float(np.rad2deg(np.median(np.abs(self.end_rad))))

    def within(self, degrees: float) -> float:
        """Share of the ascents that end within so many degrees of the truth."""
        return float((np.abs(self.end_rad) < np.deg2rad(degrees)).mean())


def local_ascent(
    model: LatentModel, views: FeatureViews, descriptors: Array, largest_rad: float, generator: np.random.Generator
) -> Ascents:
    """Ascents from starts drawn evenly up to ``largest_rad`` on either side."""
    return _ascents(model, views, descriptors, generator.uniform(-largest_rad, largest_rad, len(views)))


def gradient_ascent(
    model: LatentModel, views: FeatureViews, descriptors: Array, offset_rad: float, generator: np.random.Generator
) -> Ascents:
    """Ascents from starts exactly ``offset_rad`` off, the side drawn by lot."""
    return _ascents(model, views, descriptors, offset_rad * generator.choice([-1.0, 1.0], len(views)))


def _ascents(model: LatentModel, views: FeatureViews, descriptors: Array, offsets: Array) -> Ascents:
    start = turned(views.viewpoints, offsets)
    end = ascend_azimuth(model, start, descriptors, views.features).azimuth_rad
    return Ascents(offsets, wrap_angle(end - views.viewpoints.azimuth_rad))


@dataclass(frozen=True)
class Consistency:
    """Normalised estimation error squared of one inferred number per view: 1 on average when sigma is right."""

    nees: float
    band: tuple[float, float]  # 95 % of such averages lie in it when the model is right
    count: int
    within_two_sigma: float  # share of views; 0.954 for a Gaussian

    @property
    def consistent(self) -> bool:
        return self.band[0] <= self.nees <= self.band[1]


def nees(model: LatentModel, views: FeatureViews, descriptors: Array, sigma: Array | None = None) -> Consistency:
    """Consistency (NEES) of the azimuth inferred by ascent; ``sigma`` (F,) replaces the model's own, tempered one."""
    return consistency(azimuth_nees(model, views, descriptors, sigma))


def azimuth_nees(model: LatentModel, views: FeatureViews, descriptors: Array, sigma: Array | None = None) -> Array:
    """(N,) squared error of the inferred azimuth over its variance, view by view."""
    estimate = ascend_azimuth(model, views.viewpoints, descriptors, views.features, sigma)
    return np.asarray(wrap_angle(estimate.azimuth_rad - views.viewpoints.azimuth_rad) ** 2 / estimate.variance)


def consistency(squared: Array) -> Consistency:
    """Average of (N,) independent values that should be chi-square distributed with one degree of freedom."""
    count = len(squared)
    low, high = chi_squared_quantile([0.025, 0.975], count) / count
    return Consistency(float(squared.mean()), (float(low), float(high)), count, float((squared < 4.0).mean()))


def one_of_each_direction(views: FeatureViews, generator: np.random.Generator) -> FeatureViews:
    """One view, by lot, of those that look at an instance from one azimuth: cameras above each other err alike."""
    order = generator.permutation(len(views))
    keys = np.stack([views.instance, np.round(np.rad2deg(wrap_angle(views.viewpoints.azimuth_rad)), 1)], axis=1)[order]
    _, first = np.unique(keys, axis=0, return_index=True)
    return views.chosen(np.sort(order[first]))


def identification(model: LatentModel, views: FeatureViews) -> Array:
    """(N,) whether the view's own instance explains it best, of all that the model knows, from its known direction."""
    scores = instance_scores(model, views.viewpoints, views.features)
    truth = np.array([model.instances.names.index(name) for name in views.names])[views.instance]
    return np.asarray(scores.argmax(axis=1) == truth)


def instance_scores(model: LatentModel, viewpoints: Viewpoints, features: Array) -> Array:
    """(B, N) log-likelihood, up to a constant, of each view under each instance."""
    count = len(model.instances.names)
    mean = model.mean(repeated(viewpoints, count), np.tile(model.instances.descriptors, (len(features), 1)))
    residual = (np.repeat(features, count, axis=0) - mean) / model.noise.tempered
    return np.asarray(-0.5 * (residual**2).sum(axis=1).reshape(-1, count))


def identification_of_groups(
    model: LatentModel, views: FeatureViews, per_group: int, sigma_rad: float, generator: np.random.Generator
) -> Array:
    """Whether ``per_group`` views of one object tell which it is, while its orientation is uncertain by ``sigma_rad``.

    The told directions of a group share an error drawn with that sigma; the score integrates over it.
    """
    offsets = np.linspace(-3.0, 3.0, 25) * sigma_rad
    prior = -0.5 * (offsets / sigma_rad) ** 2
    right = []
    for index, name in enumerate(views.names):
        rows = generator.permutation(np.flatnonzero(views.instance == index))
        truth = model.instances.names.index(name)
        for start in range(0, len(rows) - per_group + 1, per_group):
            group = views.chosen(rows[start : start + per_group])
            told = turned(group.viewpoints, generator.normal(0.0, sigma_rad))
            scores = np.array(
                [
                    instance_scores(model, turned(told, -offset), group.features).sum(axis=0) + weight
                    for offset, weight in zip(offsets, prior, strict=True)
                ]
            )
            right.append(int(log_sum_exp(scores, axis=0).argmax()) == truth)
    return np.array(right)


@dataclass(frozen=True)
class Inferred:
    """Views of objects that were not trained on, and the descriptors inferred from others of their views."""

    views: FeatureViews  # those left over
    descriptors: Array  # (N, L) of each view's object
    of_object: DescriptorEstimate  # (names, L)


def descriptors_from_views(
    model: LatentModel, views: FeatureViews, per_object: int, generator: np.random.Generator
) -> Inferred:
    """The descriptor of every object from ``per_object`` of its views, spread about evenly around it."""
    used, objects = [], range(len(views.names))
    for index in objects:
        rows = np.flatnonzero(views.instance == index)
        first = generator.uniform(0.0, 2.0 * np.pi)
        wanted = first + 2.0 * np.pi * np.arange(per_object) / per_object
        azimuth = views.viewpoints.azimuth_rad[rows]
        used.append([rows[np.abs(wrap_angle(azimuth - angle)).argmin()] for angle in wanted])
    taken_rows = np.array(used)
    chosen = views.chosen(taken_rows.ravel())
    belief = infer_descriptors(model, chosen.viewpoints, chosen.features.reshape(len(used), per_object, -1))
    left = np.ones(len(views), dtype=np.bool_)
    left[taken_rows.ravel()] = False
    rest = views.chosen(left)
    return Inferred(rest, belief.mean[rest.instance], belief)


def nees_in_doubt(model: LatentModel, inferred: Inferred) -> Consistency:
    """Consistency (NEES) of the azimuth where the descriptor is no more certain than the views that it came from."""
    return consistency(squared_in_doubt(model, inferred))


def nees_tempered_by_others(model: LatentModel, inferred: Inferred) -> Consistency:
    """Consistency where each half of the objects tells how much wider sigma has to be for the other half.

    A decoder is less right about objects that it was not fitted to, however certain their descriptors are.
    """
    squared, odd = squared_in_doubt(model, inferred), inferred.views.instance % 2 == 1
    return consistency(squared / np.where(odd, squared[~odd].mean(), squared[odd].mean()))


def squared_in_doubt(model: LatentModel, inferred: Inferred) -> Array:
    """(N,) squared error of the azimuth over its variance, view by view."""
    views, own = inferred.views, inferred.of_object
    estimate = azimuth_in_doubt(model, views.viewpoints, take(own, views.instance), views.features)
    return np.asarray(wrap_angle(estimate.azimuth_rad - views.viewpoints.azimuth_rad) ** 2 / estimate.variance)
