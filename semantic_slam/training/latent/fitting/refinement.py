"""Model parameters refined together with a SLAM posterior (Eq. 5.20), as a batch over tracks around objects.

The joint posterior is climbed in turns: poses and descriptors of all tracks for fixed parameters, which is the SLAM
problem itself, then the parameters for fixed poses and descriptors. What the model knew before is rehearsed beside it:
no view of the original training is needed, which a robot does not carry.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.latent.direction import encoded
from semantic_slam.latent.latent_model import LatentModel
from semantic_slam.training.latent.fitting.gradient_descent import descend, drawn
from semantic_slam.training.latent.fitting.torch_network import exported, imported
from semantic_slam.viewpoint.model import Viewpoints


@dataclass(frozen=True)
class LocatedViews:
    """N views from tracks, at the maximum of the SLAM posterior."""

    features: Array  # (N, F)
    viewpoints: Viewpoints  # (N,)
    descriptors: Array  # (N, L)


Localise = Callable[[LatentModel], LocatedViews]
"""All tracks solved anew with a model."""


@dataclass(frozen=True)
class RefinementSettings:
    """How often and how far the parameters follow the tracks."""

    rounds: int = 2
    steps: int = 300  # of the parameters, each round
    learning_rate: float = 1e-3
    batch_size: int = 256
    rehearsal: float = 1.0  # weight of what the model predicted before
    largest_elevation_rad: float = float(np.deg2rad(36.0))  # of the rehearsed views
    seed: int = 0


def refined(model: LatentModel, localise: Localise, settings: RefinementSettings) -> LatentModel:
    """The model with a decoder that explains the tracks too; noise, encoder and instances stay."""
    original = model
    for turn in range(settings.rounds):
        model = _follow(model, original, localise(model), settings, turn)
    return model


def _follow(
    model: LatentModel, original: LatentModel, seen: LocatedViews, settings: RefinementSettings, turn: int
) -> LatentModel:
    """The decoder moved towards the tracks' features, in batches beside what ``original`` predicts elsewhere."""
    torch.set_num_threads(1)
    generator = np.random.default_rng((settings.seed, 23, turn))
    inputs = np.hstack([encoded(seen.viewpoints), seen.descriptors])
    sigma = torch.from_numpy(model.noise.tempered).float()
    decoder = imported(model.decoder)

    def misfit(rows: Array, wanted: Array) -> torch.Tensor:
        mean = decoder(torch.from_numpy(rows).float())
        return 0.5 * ((torch.from_numpy(wanted).float() - mean) / sigma).square().sum(dim=1).mean()

    def loss_of(rows: Index) -> torch.Tensor:
        rehearsed = _anywhere(original, settings, generator)
        known = misfit(rehearsed, original.decoder.value(rehearsed))
        return misfit(inputs[rows], seen.features[rows]) + settings.rehearsal * known

    batches = drawn(len(inputs), settings.batch_size, settings.steps, generator)
    groups = [{"params": decoder.parameters(), "lr": settings.learning_rate}]
    descend(groups, loss_of, batches, settings.steps, "refinement")
    return replace(model, decoder=exported(decoder), space="")


def _anywhere(model: LatentModel, settings: RefinementSettings, generator: np.random.Generator) -> Array:
    """(batch_size, inputs) of the decoder: trained instances from directions drawn by lot."""
    count = settings.batch_size
    azimuth = generator.uniform(-np.pi, np.pi, count)
    elevation = generator.uniform(0.0, settings.largest_elevation_rad, count)
    instance = generator.integers(len(model.instances.names), size=count)
    directions = encoded(Viewpoints(azimuth, elevation, np.ones(count)))
    return np.hstack([directions, model.instances.descriptors[instance]])
