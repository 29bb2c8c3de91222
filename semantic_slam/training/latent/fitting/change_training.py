"""Fitting the model over changes of viewpoint (Sec. 5.1) to pairs of views of one instance each."""

from dataclasses import dataclass

import numpy as np
import torch

from semantic_slam.geometry.arrays import Index
from semantic_slam.latent.change_model import (
    LARGEST_LOG_SIGMA,
    SMALLEST_LOG_SIGMA,
    ChangeModel,
    encoded_change,
)
from semantic_slam.latent.direction import NUM_INPUTS
from semantic_slam.training.latent.fitting.gradient_descent import descend
from semantic_slam.training.latent.fitting.torch_network import exported, tanh_network
from semantic_slam.training.latent.views.feature_views import FeatureViews
from semantic_slam.training.latent.views.view_pairs import changes, draw_pairs


@dataclass(frozen=True)
class ChangeSettings:
    """How it is fitted; changes up to ``largest_rad`` in azimuth."""

    hidden: tuple[int, ...] = (128, 128)
    largest_rad: float = float(np.pi)
    steps: int = 4000
    batch_size: int = 512
    learning_rate: float = 3e-3
    seed: int = 0


def fit_change_model(views: FeatureViews, settings: ChangeSettings) -> ChangeModel:
    """A model fitted to pairs of views of one instance each, drawn anew in every step."""
    torch.set_num_threads(1)
    torch.manual_seed(settings.seed)
    size = views.features.shape[1]
    network = tanh_network((size + NUM_INPUTS, *settings.hidden, 2 * size))
    generator = np.random.default_rng((settings.seed, 17))

    def loss_of(pair: Index) -> torch.Tensor:
        first, second = pair
        before, after = views.features[first], views.features[second]
        inputs = torch.from_numpy(np.hstack([before, encoded_change(changes(views, first, second))])).float()
        step, log_sigma = network(inputs).split(size, dim=1)
        log_sigma = log_sigma.clamp(SMALLEST_LOG_SIGMA, LARGEST_LOG_SIGMA)
        residual = (torch.from_numpy(after - before).float() - step) / log_sigma.exp()
        return (0.5 * residual.square() + log_sigma).sum(dim=1).mean()

    pairs = (
        np.stack(draw_pairs(views, settings.batch_size, settings.largest_rad, generator)) for _ in range(settings.steps)
    )
    groups = [{"params": network.parameters(), "lr": settings.learning_rate}]
    descend(groups, loss_of, pairs, settings.steps, "changes", weight_decay=1e-2)
    return ChangeModel(exported(network))
