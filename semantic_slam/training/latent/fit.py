"""From turntable views to a latent model: features, decoder and descriptors, encoder, noise, classes."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Bytes
from semantic_slam.latent.extractor import FeatureExtractor
from semantic_slam.latent.latent_model import FeatureNoise, Instances, LatentModel
from semantic_slam.training.latent.fitting.change_training import ChangeSettings, fit_change_model
from semantic_slam.training.latent.fitting.class_grounding import ground
from semantic_slam.training.latent.fitting.contrast_training import contrast
from semantic_slam.training.latent.fitting.energy_training import energy, rescale_to_bowl
from semantic_slam.training.latent.fitting.joint_training import CropViews, JointModel, JointSettings, train_jointly
from semantic_slam.training.latent.fitting.map_training import (
    EncoderSettings,
    Fitted,
    MapSettings,
    fit_encoder,
    fit_map,
)
from semantic_slam.training.latent.fitting.principal_components import principal_components
from semantic_slam.training.latent.fitting.regression_training import fit_extractor
from semantic_slam.training.latent.fitting.torch_network import exported
from semantic_slam.training.latent.judging.calibration import calibrated
from semantic_slam.training.latent.judging.new_instances import LeftOut, folds_of, new_factor
from semantic_slam.training.latent.views.feature_views import FeatureViews
from semantic_slam.training.latent.views.turntable_split import TurntableSplit
from semantic_slam.training.latent.views.view_crops import feature_views, plain_crops, room_crops
from semantic_slam.training.views import ObjectView

FORMULATIONS = ("map", "energy")
CALIBRATION_DRAWS = 3
"""Rooms that every calibration view is seen in."""


@dataclass(frozen=True)
class TrainingSettings:
    """How the shipped model was trained; ``epochs`` go over every crop once each."""

    formulation: str = "map"  # of FORMULATIONS
    draws: int = 6  # crops in rooms of every training view, beside a plain one
    num_features: int = 32
    dimensions: int = 12
    hidden: tuple[int, ...] = (96, 96)
    regression_epochs: int = 4
    contrast_epochs: int = 7
    energy_epochs: int = 2
    decoder_steps: int = 4000
    encoder_steps: int = 2000
    change_steps: int = 2500
    shaped_by_tags: bool = False  # whether tags take part in training (Eq. 5.18), or name regions of a finished space
    seed: int = 0


@dataclass(frozen=True)
class TrainedModel:
    """A model and the extractor whose features it is about."""

    model: LatentModel
    extractor: FeatureExtractor


def train(split: TurntableSplit, settings: TrainingSettings, tags: Mapping[str, str] | None = None) -> TrainedModel:
    """Learn from ``split.train`` and calibrate on ``split.calibrate``; deterministic on one machine for one seed.

    ``tags`` {instance: class} ground the latent space. Raises InputError for a formulation that there is not.
    """
    if settings.formulation not in FORMULATIONS:
        raise InputError(f"formulation '{settings.formulation}': choose one of {', '.join(FORMULATIONS)}")
    names = tuple(sorted({view.class_name for view in split.train}))
    crops = training_crops(split.train, settings)
    views = feature_views(split.train, names, np.zeros((len(crops), 0)))
    crop_views = CropViews(crops, views.instance, views.viewpoints, len(names))
    joint = _features_by_contrast(split.train, crop_views, settings)
    return finished(joint, crop_views, views, split, settings, tags)


def knowing_new_instances(trained: TrainedModel, split: TurntableSplit, settings: TrainingSettings) -> TrainedModel:
    """The model with its factor for objects that it was not fitted to: all is trained anew for every fold."""
    folds = folds_of(trained.model.instances.names)
    factor = new_factor([_left_out(split, fold, settings) for fold in folds])
    return replace(trained, model=replace(trained.model, new_factor=factor))


def _left_out(split: TurntableSplit, out: tuple[str, ...], settings: TrainingSettings) -> LeftOut:
    without = train(split.without(out), settings)
    views = [view for view in (*split.train, *split.calibrate) if view.class_name in set(out)]
    return LeftOut(without.model, seen_in_rooms(views, out, without.extractor, settings.seed + 3))


def finished(
    joint: JointModel,
    crop_views: CropViews,
    views: FeatureViews,
    split: TurntableSplit,
    settings: TrainingSettings,
    tags: Mapping[str, str] | None,
) -> TrainedModel:
    """What either formulation makes of features learned by contrast; ``views`` tell of ``crop_views`` what was seen."""
    if settings.formulation == "energy":
        rescale_to_bowl(joint, crop_views)
        train_jointly(joint, crop_views, energy, JointSettings(settings.energy_epochs, seed=settings.seed))
    extractor = joint.extractor
    seen = views.with_features(extractor.features(crop_views.crops))
    fitted = Fitted(exported(joint.decoder), joint.descriptors.detach().double().numpy().copy())
    if settings.formulation == "map":
        known = {name: tag for name, tag in (tags or {}).items() if name in views.names and settings.shaped_by_tags}
        fitted = fit_map(seen, fitted, MapSettings(steps=settings.decoder_steps, seed=settings.seed), known)
    return TrainedModel(_model(fitted, extractor, seen, split, settings, tags), extractor)


def training_crops(views: Sequence[ObjectView], settings: TrainingSettings) -> Bytes:
    """((draws + 1) * N, size, size, 3): every view in several rooms, then plain."""
    size = FeatureExtractor.input_size
    return np.concatenate([room_crops(views, size, settings.draws, settings.seed), plain_crops(views, size)])


def seen_in_rooms(
    views: Sequence[ObjectView], names: tuple[str, ...], extractor: FeatureExtractor, seed: int, draws: int = 1
) -> FeatureViews:
    """Features of the views as detections in rooms, each in so many of them."""
    crops = room_crops(views, extractor.input_size, draws, seed)
    return feature_views(views, names, extractor.features(crops))


def seen_plain(views: Sequence[ObjectView], names: tuple[str, ...], extractor: FeatureExtractor) -> FeatureViews:
    """Features of the views as clean turntable pictures."""
    return feature_views(views, names, extractor.features(plain_crops(views, extractor.input_size)))


def _features_by_contrast(views: Sequence[ObjectView], crop_views: CropViews, settings: TrainingSettings) -> JointModel:
    """Features of principal components first, whatever the room, then those that tell directions and instances."""
    plain = crop_views.crops[-len(views) :]
    components = principal_components(plain, min(64, len(plain) - 1), settings.seed)
    targets = np.tile(components.targets(plain), (len(crop_views.crops) // len(plain), 1))
    extractor = fit_extractor(crop_views.crops, targets, settings.regression_epochs, settings.seed)
    size = targets.shape[1]
    extractor.project(np.eye(settings.num_features, size), np.zeros(size))
    joint = JointModel(extractor, crop_views.num_instances, settings.dimensions, settings.hidden)
    train_jointly(joint, crop_views, contrast, JointSettings(settings.contrast_epochs, seed=settings.seed))
    return joint


def _model(
    fitted: Fitted,
    extractor: FeatureExtractor,
    seen: FeatureViews,
    split: TurntableSplit,
    settings: TrainingSettings,
    tags: Mapping[str, str] | None,
) -> LatentModel:
    """Encoder, noise, changes of viewpoint and classes added to decoder and descriptors."""
    encoder = fit_encoder(seen, fitted.descriptors, EncoderSettings(steps=settings.encoder_steps, seed=settings.seed))
    unknown = FeatureNoise(np.ones(fitted.decoder.num_outputs), 1.0)
    model = LatentModel(
        decoder=fitted.decoder,
        encoder=encoder,
        noise=unknown,
        turntable_noise=unknown,
        instances=Instances(seen.names, fitted.descriptors),
        grounding=ground(seen.names, fitted.descriptors, tags) if tags else None,
        changes=fit_change_model(seen, ChangeSettings(steps=settings.change_steps, seed=settings.seed)),
        formulation=settings.formulation,
        provenance={"training": asdict(settings)},
    )
    in_rooms = seen_in_rooms(split.calibrate, seen.names, extractor, settings.seed + 1, CALIBRATION_DRAWS)
    return calibrated(model, in_rooms, seen_plain(split.calibrate, seen.names, extractor))
