"""What features are learned with: a view must be told from other directions and other instances.

The loss is the negative log posterior of the true direction and instance under the model's own Gaussian likelihood
(Eq. 5.6 with Sigma = I), among directions drawn around the same instance, other instances in the same direction, and
the views of the batch (InfoNCE; the N-pairs loss of Sohn). Features that were all alike would leave every candidate
equally likely, so that it cannot collapse.
"""

import numpy as np
import torch
from torch import nn

from semantic_slam.geometry.arrays import Index
from semantic_slam.geometry.rows import take
from semantic_slam.training.latent.fitting.joint_training import CropViews, JointModel
from semantic_slam.training.latent.views.feature_views import repeated, turned

DIRECTIONS = 24
"""Other azimuths of the same instance that a view is told from; half of them near, as those are the hard ones."""
STRANGERS = 12
"""Other instances in its own direction that a view is told from."""
NEAR_RAD = np.pi / 4.0
ALIKE_RAD = float(np.deg2rad(6.0))
"""A direction nearer than about this is no wrong answer."""
DESCRIPTOR_NOISE = 0.1
"""Standard deviation added to descriptors in training, so that the mean stays smooth in them."""


def contrast(
    model: JointModel, features: torch.Tensor, views: CropViews, rows: Index, generator: np.random.Generator
) -> torch.Tensor:
    """Mean negative log posterior of the truth among the candidates [nats]."""
    features, sharp = model.sharpness * features, model.sharpness
    looked = take(views.viewpoints, rows)
    e = model.descriptors[torch.from_numpy(views.instance[rows])]
    e = e + DESCRIPTOR_NOISE * torch.randn_like(e)
    turns = generator.uniform(-np.pi, np.pi, (len(rows), DIRECTIONS))
    turns[:, ::2] *= NEAR_RAD / np.pi
    around = turned(repeated(looked, DIRECTIONS), turns.ravel())
    beside = _score(features, sharp * model.mean(around, e.repeat_interleave(DIRECTIONS, dim=0)))
    alike = torch.from_numpy(np.log(-np.expm1(-0.5 * (turns / ALIKE_RAD) ** 2) + 1e-6)).float()
    steps = generator.integers(1, max(views.num_instances, 2), (len(rows), STRANGERS))
    strangers = (views.instance[rows][:, None] + steps) % views.num_instances
    others = model.descriptors[torch.from_numpy(strangers.ravel())]
    strange = _score(features, sharp * model.mean(repeated(looked, STRANGERS), others))
    batch = -0.5 * torch.cdist(features, sharp * model.mean(looked, e)).square()
    return nn.functional.cross_entropy(torch.cat([batch, beside + alike, strange], dim=1), torch.arange(len(rows)))


def _score(features: torch.Tensor, means: torch.Tensor) -> torch.Tensor:
    """(B, K) log-likelihoods, up to a constant, of (B, F) features under (B * K, F) means."""
    return -0.5 * (features[:, None, :] - means.view(len(features), -1, features.shape[1])).square().sum(dim=-1)
