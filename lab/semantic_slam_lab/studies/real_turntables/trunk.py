"""What a frozen ImageNet trunk makes of crops: the means over its last map, and a coarse layout of that map."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from semantic_slam.configuration import PerceptionConfiguration
from semantic_slam.geometry.arrays import Array, Bytes
from semantic_slam.perception.networks.imagenet_networks import load_trunk
from semantic_slam.perception.networks.network import DropoutNetwork
from semantic_slam.training.augmentation import room_crop
from semantic_slam.training.latent.views.view_crops import plain_crops
from semantic_slam.training.views import ObjectView
from semantic_slam_lab.repetitions import keyed_generator, repeat

WEIGHTS = Path("weights") / "squeezenet_v1.1.pth"
LAYOUT = 4
"""Cells along each side of the map that is kept: its mean alone hardly tells left from right."""
VIEWS_PER_TASK = 60

Clutter = tuple[str, int]
"""What keys the random room that a view stands in."""


@dataclass(frozen=True)
class Features:
    """N crops as the trunk sees them; square roots, so that the strongest channels do not hide all others."""

    pooled: Array  # (N, K)
    layout: Array  # (N, K * LAYOUT**2), or the pooled ones where the trunk has no map


def trunk_settings(data: Path) -> PerceptionConfiguration:
    """SqueezeNet where the data sets bring its weights, else EfficientNet-Lite0 from its packages."""
    file = data / WEIGHTS
    if file.is_file():
        return PerceptionConfiguration(architecture="squeezenet", network=str(file))
    return PerceptionConfiguration(architecture="efficientnet_lite0", network="")


def frozen_trunk(settings: PerceptionConfiguration) -> DropoutNetwork:
    """The network; raises InputError."""
    torch.set_num_threads(1)
    return load_trunk(settings)


def plain_features(settings: PerceptionConfiguration, views: list[ObjectView], jobs: int) -> Features:
    """Features of every view alone on grey."""
    blocks = [(settings, views[i : i + VIEWS_PER_TASK], None) for i in range(0, len(views), VIEWS_PER_TASK)]
    return _joined(repeat(_features, blocks, jobs, "plain views"))


def cluttered_features(
    settings: PerceptionConfiguration, views: list[ObjectView], keys: list[Clutter], jobs: int
) -> Features:
    """Features of every view in a room, with something before it at times; each keyed alone."""
    starts = range(0, len(views), VIEWS_PER_TASK)
    blocks = [(settings, views[i : i + VIEWS_PER_TASK], keys[i : i + VIEWS_PER_TASK]) for i in starts]
    return _joined(repeat(_features, blocks, jobs, "views in rooms"))


def _features(settings: PerceptionConfiguration, views: list[ObjectView], keys: list[Clutter] | None) -> Features:
    network = frozen_trunk(settings)
    size, rows = network.input_size, []
    for index, view in enumerate(views):
        crop = room_crop(view, size, _generator(view, keys[index])) if keys else plain_crops([view], size)[0]
        rows.append(_row(network, crop))
    pooled, layout = (np.stack([row[part] for row in rows]) for part in range(2))
    return Features(pooled, layout)


def _generator(view: ObjectView, key: Clutter) -> np.random.Generator:
    return keyed_generator("real_turntables", "room", view.class_name, view.angle_deg, *key)


def _row(network: DropoutNetwork, crop: Bytes) -> tuple[Array, Array]:
    with torch.inference_mode():
        descriptor, pooled = network.appearance(network.normalise(crop[None]))
        is_map = descriptor.ndim == 4
        layout = torch.nn.functional.adaptive_avg_pool2d(descriptor, LAYOUT).flatten(1) if is_map else pooled
        return _rooted(pooled), _rooted(layout)


def _rooted(values: torch.Tensor) -> Array:
    array = values[0].numpy()
    return np.asarray(np.sign(array) * np.sqrt(np.abs(array)), dtype=np.float32)


def _joined(parts: list[Features]) -> Features:
    return Features(np.concatenate([part.pooled for part in parts]), np.concatenate([part.layout for part in parts]))
