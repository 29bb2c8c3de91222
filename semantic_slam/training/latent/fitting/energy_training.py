"""Energy minimisation (Sec. 5.E, Eqs. 5.15-5.17): a log-likelihood that is a bowl around the truth.

Only the quadratic forms are compared, with Sigma = I: constants of the two densities would pull all features together.
It starts from a model learned by contrast, without which the pose is ignored. The data term looks no further than the
bowl: left alone it forgets what tells far directions and other instances apart, so that contrast stays beside it.
"""

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from semantic_slam.geometry.arrays import Index
from semantic_slam.geometry.rows import take
from semantic_slam.training.latent.fitting.contrast_training import contrast
from semantic_slam.training.latent.fitting.joint_training import CropViews, JointModel
from semantic_slam.training.latent.views.feature_views import turned
from semantic_slam.viewpoint.model import Viewpoints

BOWL_RAD = 0.25
"""Standard deviation of the target delta(dx, de) along azimuth and elevation (the thesis's epsilon)."""
BOWL_DESCRIPTOR = 0.25
"""Standard deviation of the target delta(dx, de) along every component of the descriptor."""
PERTURBED = ((0.0, 0.0), (1.0, 0.0), (1.0, 0.0), (1.0, 1.0))
"""How far pose and descriptor are perturbed in each of the sets that the data term averages over."""
ORDER_WEIGHT = 0.1
ORDER_MARGIN = 0.05
CONTRAST_WEIGHT = 0.5
NUDGE_RAD = 0.05


def energy(
    model: JointModel, features: torch.Tensor, views: CropViews, rows: Index, generator: np.random.Generator
) -> torch.Tensor:
    """Data term (Eq. 5.16), the extractor's (Eq. 5.17), and contrast."""
    looked = take(views.viewpoints, rows)
    e = model.descriptors[torch.from_numpy(views.instance[rows])]
    terms = [_bowl_term(model, features, looked, e, pose, latent, generator) for pose, latent in PERTURBED]
    ordered = ORDER_WEIGHT * _order_term(features, views.crops[rows])
    return torch.stack(terms).mean() + ordered + CONTRAST_WEIGHT * contrast(model, features, views, rows, generator)


def rescale_to_bowl(model: JointModel, views: CropViews) -> None:
    """Shrink features and means until a turn moves the mean as the bowl wants; what they tell apart stays the same."""
    with torch.no_grad():
        e = model.descriptors[torch.from_numpy(views.instance)]
        moved = model.mean(turned(views.viewpoints, NUDGE_RAD), e) - model.mean(views.viewpoints, e)
        scale = float(moved.norm(dim=1).median()) / NUDGE_RAD * BOWL_RAD
        for layer in (model.extractor.head, model.decoder[-1]):
            layer.weight /= scale
            layer.bias /= scale
    model.sharpness *= scale


def _bowl_term(
    model: JointModel,
    features: torch.Tensor,
    looked: Viewpoints,
    e: torch.Tensor,
    pose: float,
    latent: float,
    generator: np.random.Generator,
) -> torch.Tensor:
    """|1/2 |z - mu(x + dx, e + de)|^2 - 1/2 (|dx / eps|^2 + |de / eps|^2)|, dx and de drawn from the target."""
    by_pose = pose * generator.normal(size=(2, len(e)))
    by_latent = latent * torch.from_numpy(generator.normal(size=tuple(e.shape))).float()
    moved = Viewpoints(
        looked.azimuth_rad + BOWL_RAD * by_pose[0], looked.elevation_rad + BOWL_RAD * by_pose[1], looked.range_m
    )
    mean = model.mean(moved, e + BOWL_DESCRIPTOR * by_latent)
    target = torch.from_numpy((by_pose**2).sum(axis=0)).float() + by_latent.square().sum(dim=1)
    return (0.5 * (features - mean).square().sum(dim=1) - 0.5 * target).abs().mean()


def _order_term(features: torch.Tensor, crops: NDArray[Any]) -> torch.Tensor:
    """Hinge loss on triplets: what is closer as a picture is to be closer as a feature; squared differences both."""
    pixels = torch.from_numpy(crops.reshape(len(crops), -1)).float() / 255.0
    order = torch.randperm(len(crops))
    second, third = order, order.roll(1)
    pictures = [(pixels - pixels[other]).square().sum(dim=1) for other in (second, third)]
    distances = [(features - features[other]).square().sum(dim=1) for other in (second, third)]
    closer = torch.where(pictures[0] < pictures[1], 1.0, -1.0)
    return torch.relu(closer * (distances[0] - distances[1]) + ORDER_MARGIN).mean()
