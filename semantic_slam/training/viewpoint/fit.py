"""From turntable views to viewpoint models: measure every view as in a room, fit, and check on views left out."""

import hashlib
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from tqdm import tqdm

from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Array
from semantic_slam.perception.networks.mc_dropout import probe_features, samples_of_head, seen
from semantic_slam.perception.networks.network import ClassifierNetwork, DropoutNetwork
from semantic_slam.perception.uncertainty import sample_covariance
from semantic_slam.training.appearance import fit_appearance
from semantic_slam.training.augmentation import room_crop
from semantic_slam.training.other_things import other_crop
from semantic_slam.training.viewpoint.calibration import Residuals, left_out_residuals, report_of
from semantic_slam.training.viewpoint.regression import fit_class
from semantic_slam.training.viewpoint.samples import FOLDS, ClassSamples, check_samples
from semantic_slam.training.views import ObjectView
from semantic_slam.viewpoint.appearance import KnownAppearance
from semantic_slam.viewpoint.spherical_process import fitted_classes
from semantic_slam.viewpoint.store import FittedModel

Direction = tuple[int, ...]
"""Steps of azimuth and, where heights are told apart, of elevation."""


SAME_HEIGHT_RAD = 1e-6
"""Elevations that differ by less are one."""

LEAST_DIRECTIONS = FOLDS
"""Directions of an object from which on a model is fitted to it: one for every fold of views left out."""

MOST_OTHERS = 2000
"""Pictures of other things; of fewer pictures of known objects as many."""


@dataclass(frozen=True)
class FitSettings:
    """How views become data."""

    azimuth_step_deg: float = 3.0  # views within one step are one direction; their ranges are nuisances
    elevation_step_deg: float = 0.0  # likewise; 0: elevations are nuisances, too
    draws: int = 8  # crops per direction, each with its own background, light, box and view
    num_passes: int = 50
    seed: int = 0


@dataclass(frozen=True)
class FittedModels:
    """Models of all classes, and how honest they are about views that they were not fitted to."""

    model: FittedModel
    left_out: dict[str, Residuals]  # by class, of views left out of the fit
    report: dict[str, Any]  # by class, what is kept as JSON


def fit_samples(samples: dict[str, ClassSamples], feature_names: tuple[str, ...]) -> FittedModels:
    """Model of every class, and its residuals of views left out of the fit; over one angle where all are of one height.

    What is of one height is told by azimuth alone, as if nobody had measured heights. Raises InputError.
    """
    check_samples(samples, len(feature_names))
    samples, names = _at_heights(samples), tuple(samples)
    fits = [fit_class(samples[name]) for name in tqdm(names, desc="fitting", unit="class")]
    left_out = {name: left_out_residuals(samples[name], feature_names) for name in names}
    model = fitted_classes(names, feature_names, fits)
    return FittedModels(model, left_out, report_of(samples, left_out))


def _at_heights(samples: dict[str, ClassSamples]) -> dict[str, ClassSamples]:
    """The samples, without elevations unless these differ."""
    told = [data.elevation_rad for data in samples.values() if data.elevation_rad is not None]
    if len(told) == len(samples) and np.ptp(np.concatenate(told)) > SAME_HEIGHT_RAD:
        return samples
    return {name: replace(data, elevation_rad=None) for name, data in samples.items()}


def appearance_of(samples: dict[str, ClassSamples], classifier: ClassifierNetwork) -> KnownAppearance | None:
    """What the objects of all classes look like; None where no pictures were measured, or too few."""
    features, classes, views = [], [], []
    for index, data in enumerate(samples.values()):
        if data.appearances is None:
            return None
        count, draws, size = data.appearances.shape
        features.append(data.appearances.reshape(-1, size))
        classes.append(np.full(count * draws, index))
        views.append(np.repeat(np.arange(count), draws))
    others = other_features(classifier.network, min(sum(map(len, features)), MOST_OTHERS))
    probe = probe_features(classifier.network)
    return fit_appearance(np.concatenate(features), np.concatenate(classes), np.concatenate(views), others, probe)


def other_features(network: DropoutNetwork, count: int) -> Array:
    """(N, K) features of ``count`` pictures of things that are made up, the same ones for every network."""
    generators = [_generator(0, "other things", str(number)) for number in range(count)]
    with tqdm(generators, desc="measuring other things", unit="picture") as progress:
        return np.array([seen(network, other_crop(network.input_size, own)).appearance for own in progress])


def with_enough_directions(
    views: Sequence[ObjectView], settings: FitSettings
) -> tuple[list[ObjectView], dict[str, int]]:
    """Views of the classes seen from ``LEAST_DIRECTIONS`` at least, and the counts of those left out, by reason.

    Raises InputError when no class is left.
    """
    directions: dict[str, set[Direction]] = defaultdict(set)
    for view in views:
        directions[view.class_name].add(_direction(view, settings))
    few = {name for name, own in directions.items() if len(own) < LEAST_DIRECTIONS}
    if len(few) == len(directions):
        raise InputError(f"turntables: no object was seen from {LEAST_DIRECTIONS} directions; give more views of each")
    left_out = Counter(
        f"views: fewer than {LEAST_DIRECTIONS} directions of '{view.class_name}'"
        for view in views
        if view.class_name in few
    )
    return [view for view in views if view.class_name not in few], dict(left_out)


def measure_views(
    views: Sequence[ObjectView], classifier: ClassifierNetwork, settings: FitSettings
) -> dict[str, ClassSamples]:
    """Features of each class, by name in sorted order, in every direction that has views."""
    directions: dict[str, dict[Direction, list[ObjectView]]] = defaultdict(lambda: defaultdict(list))
    for view in views:
        directions[view.class_name][_direction(view, settings)].append(view)
    total = sum(len(of_class) for of_class in directions.values())
    with tqdm(total=total, desc="measuring views", unit="direction") as progress:
        return {name: _class_samples(directions[name], classifier, settings, progress) for name in sorted(directions)}


def _direction(view: ObjectView, settings: FitSettings) -> Direction:
    steps = round(360.0 / settings.azimuth_step_deg)
    around = round(np.rad2deg(view.azimuth_rad) / settings.azimuth_step_deg) % steps
    if not settings.elevation_step_deg:
        return (around,)
    return around, round(np.rad2deg(view.elevation_rad) / settings.elevation_step_deg)


def _class_samples(
    directions: dict[Direction, list[ObjectView]],
    classifier: ClassifierNetwork,
    settings: FitSettings,
    progress: "tqdm[Any]",
) -> ClassSamples:
    azimuth, elevation, features, covariances, appearances = [], [], [], [], []
    for index in sorted(directions):
        group = directions[index]
        generator = _generator(settings.seed, group[0].class_name, ":".join(map(str, index)))
        pictures = [_measured(group, classifier, settings, generator) for _ in range(settings.draws)]
        drawn = np.stack([samples for samples, _ in pictures])
        phase = sum(np.exp(1j * view.azimuth_rad) for view in group)
        azimuth.append(float(np.angle(phase)))
        elevation.append(float(np.mean([view.elevation_rad for view in group])))
        features.append(drawn.mean(axis=1))
        covariances.append(sample_covariance(drawn))
        appearances.append(np.stack([appearance for _, appearance in pictures]))
        progress.update()
    return ClassSamples(
        azimuth_rad=np.array(azimuth),
        features=np.stack(features),
        feature_covariances=np.stack(covariances),
        elevation_rad=np.array(elevation) if settings.elevation_step_deg else None,
        appearances=np.stack(appearances),
    )


def _measured(
    group: list[ObjectView], classifier: ClassifierNetwork, settings: FitSettings, generator: np.random.Generator
) -> tuple[Array, Array]:
    """(T, F) features of one random crop of one of the views, and (K,) what it looks like."""
    crop = room_crop(group[generator.integers(len(group))], classifier.network.input_size, generator)
    once = seen(classifier.network, crop)
    samples = samples_of_head(classifier.network, once.descriptor, settings.num_passes, generator)
    return classifier.reported(samples), once.appearance


def _generator(seed: int, class_name: str, direction: str) -> np.random.Generator:
    digest = hashlib.blake2b(f"views:{seed}:{class_name}:{direction}".encode(), digest_size=16).digest()
    return np.random.Generator(np.random.Philox(key=int.from_bytes(digest, "little")))
