"""Joint posterior maximisation (Sec. 5.A, Eqs. 5.7-5.13): decoder and one descriptor per instance, then the encoder."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from torch import nn

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.latent.direction import encoded
from semantic_slam.latent.smooth_network import SmoothNetwork
from semantic_slam.training.latent.fitting.class_grounding import tagged_rows
from semantic_slam.training.latent.fitting.gradient_descent import descend, drawn
from semantic_slam.training.latent.fitting.latent_prior import PRIORS
from semantic_slam.training.latent.fitting.torch_network import exported, imported, tanh_network
from semantic_slam.training.latent.views.feature_views import FeatureViews


@dataclass(frozen=True)
class MapSettings:
    """How decoder and descriptors are fitted."""

    prior: str = "n_pairs"  # a name of PRIORS
    prior_weight: float = 1.0
    descriptor_noise: float = 0.05  # of each descriptor while it trains, so that mu stays smooth in e
    steps: int = 4000
    batch_size: int = 512
    learning_rate: float = 1e-3
    seed: int = 0


@dataclass(frozen=True)
class Fitted:
    """Parameters at the maximum of Eq. 5.7."""

    decoder: SmoothNetwork
    descriptors: Array  # (instances, L)


class _Instances(nn.Module):  # type: ignore[misc]  # torch is not followed by mypy
    """Descriptors and, where instances carry tags, the Gaussians of their classes (Eq. 5.19), all learned."""

    def __init__(self, names: tuple[str, ...], descriptors: Array, tags: Mapping[str, str]) -> None:
        super().__init__()
        self.descriptors = nn.Parameter(torch.from_numpy(descriptors).float())
        tagged = tagged_rows(names, tags) if tags else []
        classes = sorted({name for _, name in tagged})
        self.rows = torch.tensor([row for row, _ in tagged], dtype=torch.long)
        self.class_index = torch.tensor([classes.index(name) for _, name in tagged], dtype=torch.long)
        self.means = nn.Parameter(torch.zeros(len(classes), descriptors.shape[1]))
        self.log_sigma = nn.Parameter(torch.zeros(descriptors.shape[1]))

    def class_term(self) -> torch.Tensor:
        """-log prod_i P(e_i | c_i), with one spread for all classes that cannot shrink away."""
        if not len(self.rows):
            return torch.zeros(())
        log_sigma = torch.clamp(self.log_sigma, min=-1.0)
        offset = (self.descriptors[self.rows] - self.means[self.class_index]) / log_sigma.exp()
        return (0.5 * offset.square() + log_sigma).sum() / len(self.descriptors)


def fit_map(views: FeatureViews, start: Fitted, settings: MapSettings, tags: Mapping[str, str] | None = None) -> Fitted:
    """Maximise P(features, descriptors | directions, instances[, tags]) from a start; the noise is learned too."""
    torch.set_num_threads(1)
    torch.manual_seed(settings.seed)
    decoder = imported(start.decoder)
    instances = _Instances(views.names, start.descriptors, tags or {})
    spread = views.features.std(axis=0)
    log_sigma = nn.Parameter(torch.from_numpy(np.log(0.5 * spread)).float())
    parameters = [*decoder.parameters(), *instances.parameters(), log_sigma]
    directions = torch.from_numpy(encoded(views.viewpoints)).float()
    targets, of_view = torch.from_numpy(views.features).float(), torch.from_numpy(views.instance)
    prior, generator = PRIORS[settings.prior], np.random.default_rng((settings.seed, 11))

    def loss_of(chosen: Index) -> torch.Tensor:
        rows = torch.from_numpy(chosen)
        e = instances.descriptors[of_view[rows]]
        mean = decoder(torch.cat([directions[rows], e + settings.descriptor_noise * torch.randn_like(e)], dim=1))
        residual = (targets[rows] - mean) / log_sigma.exp()
        data_term = (0.5 * residual.square() + log_sigma).sum(dim=1).mean()
        return data_term + settings.prior_weight * (prior(instances.descriptors) + instances.class_term())

    batches = drawn(len(views), settings.batch_size, settings.steps, generator)
    descend([{"params": parameters, "lr": settings.learning_rate}], loss_of, batches, settings.steps, "decoder")
    return Fitted(exported(decoder), instances.descriptors.detach().double().numpy().copy())


@dataclass(frozen=True)
class EncoderSettings:
    """How P(e | f) is fitted (Eq. 5.13)."""

    hidden: int = 96
    steps: int = 2500
    batch_size: int = 512
    learning_rate: float = 3e-3
    seed: int = 0


def fit_encoder(views: FeatureViews, descriptors: Array, settings: EncoderSettings) -> SmoothNetwork:
    """Features to mean and log sigma of their instance's descriptor, sigma in units of the descriptors' spread."""
    torch.set_num_threads(1)
    torch.manual_seed(settings.seed)
    dimensions = descriptors.shape[1]
    network = tanh_network((views.features.shape[1], settings.hidden, settings.hidden, 2 * dimensions))
    features = torch.from_numpy(views.features).float()
    targets = torch.from_numpy(descriptors[views.instance]).float()
    scale = torch.from_numpy(np.maximum(descriptors.std(axis=0), 1e-3)).float()
    generator = np.random.default_rng((settings.seed, 13))

    def loss_of(chosen: Index) -> torch.Tensor:
        rows = torch.from_numpy(chosen)
        mean, log_sigma = network(features[rows]).split(dimensions, dim=1)
        residual = (targets[rows] - mean) / (scale * log_sigma.exp())
        return (0.5 * residual.square() + log_sigma).sum(dim=1).mean()

    batches = drawn(len(views), settings.batch_size, settings.steps, generator)
    groups = [{"params": network.parameters(), "lr": settings.learning_rate}]
    descend(groups, loss_of, batches, settings.steps, "encoder", weight_decay=1e-2)
    return exported(network)
