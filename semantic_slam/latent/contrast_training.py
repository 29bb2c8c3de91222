"""Learning the extractor together with the model: features must tell a view's direction and instance from others.

The loss is the negative log posterior of the true direction and instance under the model's own Gaussian likelihood
(Eq. 5.6 with Sigma = I), among directions drawn around the same instance and the views of the batch (InfoNCE, the
N-pairs loss of Sohn). It cannot collapse: features that are all alike would leave every candidate equally likely.
"""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn
from tqdm import tqdm

from semantic_slam.latent.direction import NUM_INPUTS, encoded
from semantic_slam.latent.extractor import FeatureExtractor
from semantic_slam.latent.feature_views import repeated, taken, turned
from semantic_slam.latent.latent_prior import PRIORS
from semantic_slam.latent.torch_network import tanh_network
from semantic_slam.viewpoint.model import Viewpoints

Array = NDArray[np.float64]
Bytes = NDArray[np.uint8]
Indices = NDArray[np.int_]


@dataclass(frozen=True)
class CropViews:
    """N crops of instances seen from known directions; what the features are learned from."""

    crops: Bytes  # (N, size, size, 3)
    instance: Indices  # (N,)
    viewpoints: Viewpoints
    num_instances: int


@dataclass(frozen=True)
class ContrastSettings:
    """How the extractor is learned."""

    num_features: int = 32
    dimensions: int = 12
    hidden: tuple[int, ...] = (96, 96)
    directions: int = 24  # other azimuths of the same instance that a view is told from
    descriptor_noise: float = 0.1
    prior: str = "n_pairs"
    prior_weight: float = 0.1
    epochs: int = 6
    batch_size: int = 128
    learning_rate: float = 2e-3
    seed: int = 0


class JointModel(nn.Module):  # type: ignore[misc]  # torch is not followed by mypy
    """Extractor, decoder and one descriptor per instance, learned together."""

    def __init__(self, extractor: FeatureExtractor, num_instances: int, dimensions: int, hidden: tuple[int, ...]):
        super().__init__()
        self.extractor = extractor
        self.decoder = tanh_network((NUM_INPUTS + dimensions, *hidden, extractor.num_features))
        self.descriptors = nn.Parameter(0.3 * torch.randn(num_instances, dimensions))

    def mean(self, viewpoints: Viewpoints, descriptors: torch.Tensor) -> torch.Tensor:
        """(B, F) mu(x_rel, e)."""
        return self.decoder(torch.cat([torch.from_numpy(encoded(viewpoints)).float(), descriptors], dim=1))


def contrast_loss(
    model: JointModel, features: torch.Tensor, views: CropViews, rows: Indices, settings: ContrastSettings,
    generator: np.random.Generator,
) -> torch.Tensor:
    """Mean negative log posterior of the truth among the candidates, for the (B, F) features of ``rows``."""
    looked = taken(views.viewpoints, rows)
    e = model.descriptors[torch.from_numpy(views.instance[rows])]
    e = e + settings.descriptor_noise * torch.randn_like(e)
    turns = generator.uniform(-np.pi, np.pi, (len(rows), settings.directions))
    turns[:, : settings.directions // 2] *= 0.25  # near ones are the hard ones
    others = turned(repeated(looked, settings.directions), turns.ravel())
    beside = model.mean(others, e.repeat_interleave(settings.directions, dim=0)).view(*turns.shape, -1)
    own = model.mean(looked, e)
    same = -0.5 * (features[:, None, :] - beside).square().sum(dim=-1)
    batch = -0.5 * torch.cdist(features, own).square()
    # Too near a direction is no wrong answer.
    same = same + torch.from_numpy(np.log(-np.expm1(-0.5 * (turns / np.deg2rad(6.0)) ** 2) + 1e-6)).float()
    scores = torch.cat([batch, same], dim=1)
    return nn.functional.cross_entropy(scores, torch.arange(len(rows)))


def fit_contrast(extractor: FeatureExtractor, views: CropViews, settings: ContrastSettings) -> JointModel:
    """Learn on from the given extractor; it is changed in place."""
    torch.set_num_threads(1)
    torch.manual_seed(settings.seed)
    model = JointModel(extractor, views.num_instances, settings.dimensions, settings.hidden)
    extractor.requires_grad_(True).train()
    rates = [
        {"params": extractor.parameters(), "lr": settings.learning_rate},
        {"params": [*model.decoder.parameters(), model.descriptors], "lr": 2.0 * settings.learning_rate},
    ]
    optimiser = torch.optim.AdamW(rates, weight_decay=1e-3)
    steps = len(views.crops) // settings.batch_size
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, [group["lr"] for group in rates], total_steps=settings.epochs * steps
    )
    generator = np.random.default_rng((settings.seed, 5))
    progress = tqdm(range(settings.epochs), desc="features", unit="epoch")
    for _ in progress:
        order, total = generator.permutation(len(views.crops)), 0.0
        for step in range(steps):
            rows = order[step * settings.batch_size : (step + 1) * settings.batch_size]
            features = extractor(extractor.normalise(views.crops[rows]))
            loss = contrast_loss(model, features, views, rows, settings, generator)
            total += loss.item()
            loss = loss + settings.prior_weight * PRIORS[settings.prior](model.descriptors)
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            schedule.step()
        progress.set_postfix(loss=f"{total / max(steps, 1):.4f}")
    extractor.requires_grad_(False).eval()
    return model
