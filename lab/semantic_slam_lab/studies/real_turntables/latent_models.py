"""Latent models of both formulations over features of the frozen trunk: a projection is learned, the trunk is not."""

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.latent.latent_model import FeatureNoise, Instances, LatentModel
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
from semantic_slam.training.latent.fitting.torch_network import exported
from semantic_slam.training.latent.judging.calibration import feature_noise
from semantic_slam.training.latent.judging.new_instances import LeftOut, folds_of, new_factor
from semantic_slam.training.latent.views.feature_views import FeatureViews
from semantic_slam.viewpoint.model import Viewpoints
from semantic_slam_lab.studies.real_turntables.photographs import Photographs

FORMULATIONS = ("map", "energy")
Components = NDArray[np.float32]
COMPONENTS = 192
"""Principal components of the training views that the projection starts from."""
NUM_FEATURES, DIMENSIONS, HIDDEN = 32, 12, (192, 192)


@dataclass(frozen=True)
class Effort:
    """How long everything is trained."""

    contrast_epochs: int = 120
    energy_epochs: int = 80
    decoder_steps: int = 3000
    encoder_steps: int = 1500
    decoder_rate: float = 3e-3  # photographs of unlike objects: slower, the decoder does not follow the features


QUICK = Effort(contrast_epochs=20, energy_epochs=5, decoder_steps=500, encoder_steps=200)


@dataclass(frozen=True)
class Parts:
    """Rows of the photographs, and the instances that the model is fitted to."""

    known: tuple[str, ...]
    train: Index
    calibrate: Index

    def without(self, photographs: Photographs, names: tuple[str, ...]) -> "Parts":
        """The parts as if some instances were not there."""
        left = tuple(name for name in self.known if name not in names)
        wanted = np.isin(np.array(photographs.names)[photographs.instance], left)
        return Parts(left, self.train[wanted[self.train]], self.calibrate[wanted[self.calibrate]])


class Projection(nn.Module):  # type: ignore[misc]  # torch is not followed by mypy
    """A linear layer on principal components, in the place of an extractor; it starts as the first of them."""

    def __init__(self, inputs: int) -> None:
        super().__init__()
        self.head = nn.Linear(inputs, NUM_FEATURES)
        with torch.no_grad():
            self.head.weight.copy_(torch.eye(NUM_FEATURES, inputs))
            self.head.bias.zero_()

    @property
    def num_features(self) -> int:
        return NUM_FEATURES

    def normalise(self, components: Components) -> torch.Tensor:
        """(N, inputs) components as they are."""
        return torch.from_numpy(components)

    def forward(self, components: torch.Tensor) -> torch.Tensor:
        """(N, inputs) to (N, F)."""
        features: torch.Tensor = self.head(components)
        return features


def principal_components(layout: Array, train: Index) -> Components:
    """(N, COMPONENTS) of (N, D) features, directions from the training rows, each divided by its root spread."""
    mean = layout[train].mean(axis=0)
    _, strength, basis = np.linalg.svd(layout[train] - mean, full_matrices=False)
    count = min(COMPONENTS, len(train) - 1)
    spread = strength[:count] / np.sqrt(len(train))
    return np.asarray((layout - mean) @ basis[:count].T / np.sqrt(spread * spread[0]), dtype=np.float32)


def feature_views(
    photographs: Photographs, rows: Index, names: tuple[str, ...], features: Array | Components
) -> FeatureViews:
    """The rows' directions and instances, numbered as in ``names``, beside their features."""
    number = {photographs.names.index(name): index for index, name in enumerate(names)}
    instance = np.array([number[own] for own in photographs.instance[rows]])
    elevation = np.array([photographs.views[row].elevation_rad for row in rows])
    range_m = np.array([photographs.views[row].range_m for row in rows])
    viewpoints = Viewpoints(photographs.azimuth_rad[rows], elevation, range_m)
    return FeatureViews(names, instance, viewpoints, features[rows].astype(np.float64))


def trained(
    formulation: str, photographs: Photographs, components: Components, parts: Parts, effort: Effort, seed: int
) -> tuple[LatentModel, Array]:
    """The model and the (N, F) features of all photographs that it is about."""
    torch.set_num_threads(1)
    torch.manual_seed(seed)
    views = feature_views(photographs, parts.train, parts.known, components)
    joint = JointModel(Projection(components.shape[1]), len(parts.known), DIMENSIONS, HIDDEN)
    seen = CropViews(components[parts.train], views.instance, views.viewpoints, len(parts.known))
    train_jointly(joint, seen, contrast, JointSettings(effort.contrast_epochs, seed=seed))
    if formulation == "energy":
        rescale_to_bowl(joint, seen)
        train_jointly(joint, seen, energy, JointSettings(effort.energy_epochs, seed=seed))
    with torch.inference_mode():
        features = joint.extractor(torch.from_numpy(components)).numpy()
    views = views.with_features(features[parts.train].astype(np.float64))
    decoder = MapSettings(steps=effort.decoder_steps, learning_rate=effort.decoder_rate, seed=seed)
    fitted = Fitted(exported(joint.decoder), joint.descriptors.detach().double().numpy().copy())
    if formulation == "map":
        fitted = fit_map(views, fitted, decoder)
    encoder = EncoderSettings(steps=effort.encoder_steps, seed=seed)
    unknown = FeatureNoise(np.ones(NUM_FEATURES), 1.0)
    model = LatentModel(
        decoder=fitted.decoder,
        encoder=fit_encoder(views, fitted.descriptors, encoder),
        noise=unknown,
        turntable_noise=unknown,
        instances=Instances(parts.known, fitted.descriptors),
        formulation=formulation,
    )
    calibration = feature_views(photographs, parts.calibrate, parts.known, features)
    return replace(model, noise=feature_noise(model, calibration)), features


def factor_of_new_objects(
    formulation: str, photographs: Photographs, layout: Array, parts: Parts, effort: Effort, seed: int
) -> float | None:
    """What sigma is multiplied by for objects that the model was not fitted to; all is learned anew for every fold."""
    left_out = []
    for out in folds_of(parts.known):
        inside = parts.without(photographs, out)
        model, features = trained(
            formulation, photographs, principal_components(layout, inside.train), inside, effort, seed
        )
        views = np.setdiff1d(np.concatenate([parts.train, parts.calibrate]), [*inside.train, *inside.calibrate])
        left_out.append(LeftOut(model, feature_views(photographs, views, out, features)))
    return new_factor(left_out)
