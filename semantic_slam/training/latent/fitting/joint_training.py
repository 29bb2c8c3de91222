"""Learning extractor, decoder and descriptors together from crops; the loss is the formulation's."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from semantic_slam.geometry.arrays import Index
from semantic_slam.latent.direction import NUM_INPUTS, encoded
from semantic_slam.latent.extractor import FeatureExtractor
from semantic_slam.training.latent.fitting.gradient_descent import descend, num_batches, shuffled
from semantic_slam.training.latent.fitting.latent_prior import PRIORS
from semantic_slam.training.latent.fitting.torch_network import tanh_network
from semantic_slam.viewpoint.model import Viewpoints


@dataclass(frozen=True)
class CropViews:
    """N crops of instances seen from known directions, or what a frozen network makes of them."""

    crops: NDArray[Any]  # (N, size, size, 3) bytes, or (N, K) float32: whatever the extractor takes
    instance: Index  # (N,)
    viewpoints: Viewpoints
    num_instances: int


@dataclass(frozen=True)
class JointSettings:
    """How long and how fast; ``prior`` is a name of latent_prior.PRIORS."""

    epochs: int
    prior: str = "n_pairs"
    prior_weight: float = 0.1
    batch_size: int = 128
    learning_rate: float = 2e-3
    seed: int = 0


class JointModel(nn.Module):  # type: ignore[misc]  # torch is not followed by mypy
    """Extractor, decoder and one descriptor per instance."""

    def __init__(self, extractor: FeatureExtractor, num_instances: int, dimensions: int, hidden: tuple[int, ...]):
        super().__init__()
        self.extractor = extractor
        self.decoder = tanh_network((NUM_INPUTS + dimensions, *hidden, extractor.num_features))
        self.descriptors = nn.Parameter(0.3 * torch.randn(num_instances, dimensions))
        self.sharpness = 1.0  # 1 / sigma of the likelihood that views are told apart with

    def features(self, crops: NDArray[Any]) -> torch.Tensor:
        """(B, F) features of crops, with gradients."""
        features: torch.Tensor = self.extractor(self.extractor.normalise(crops))
        return features

    def mean(self, viewpoints: Viewpoints, descriptors: torch.Tensor) -> torch.Tensor:
        """(B, F) predicted mean features mu(x_rel, e)."""
        directions = torch.from_numpy(encoded(viewpoints)).float()
        mean: torch.Tensor = self.decoder(torch.cat([directions, descriptors], dim=1))
        return mean


Loss = Callable[[JointModel, torch.Tensor, CropViews, Index, np.random.Generator], torch.Tensor]
"""Training loss of a batch, from model, (B, F) features, all views, (B,) rows of the batch, random numbers."""


def train_jointly(model: JointModel, views: CropViews, loss_function: Loss, settings: JointSettings) -> None:
    """Minimise the loss and the prior over the descriptors; the model is changed in place and left in evaluation."""
    torch.set_num_threads(1)
    torch.manual_seed(settings.seed)
    model.extractor.to(memory_format=torch.channels_last)  # faster on a CPU
    model.requires_grad_(True).train()
    groups = [
        {"params": model.extractor.parameters(), "lr": settings.learning_rate},
        {"params": [*model.decoder.parameters(), model.descriptors], "lr": 2.0 * settings.learning_rate},
    ]
    generator = np.random.default_rng((settings.seed, 5))

    def loss_of(rows: Index) -> torch.Tensor:
        data_term = loss_function(model, model.features(views.crops[rows]), views, rows, generator)
        return data_term + settings.prior_weight * PRIORS[settings.prior](model.descriptors)

    batches = shuffled(len(views.crops), settings.batch_size, settings.epochs, generator)
    total = settings.epochs * num_batches(len(views.crops), settings.batch_size)
    descend(groups, loss_of, batches, total, loss_function.__name__, weight_decay=1e-3)
    model.requires_grad_(False).eval()
