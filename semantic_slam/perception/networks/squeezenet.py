"""SqueezeNet 1.1 in plain torch, for torchvision's state dicts and those of the network's authors."""

import re

import numpy as np
import torch
from torch import nn

from semantic_slam.geometry.arrays import Bytes
from semantic_slam.perception.networks.network import normalised

ARCHITECTURE = "squeezenet"
NUM_CLASSES = 1000
MEAN_BGR = (104.0, 117.0, 123.0)
"""Channel means (BGR) subtracted from unscaled pixels in the authors' training."""
FIRES = (
    (64, 16, 64),
    (128, 16, 64),
    (128, 32, 128),
    (256, 32, 128),
    (256, 48, 192),
    (384, 48, 192),
    (384, 64, 256),
    (512, 64, 256),
)
"""Channels of the fire modules: input, squeezed, and expanded in each of two halves."""
FIRES_OF_TORCHVISION = (3, 4, 6, 7, 9, 10, 11, 12)
"""Indices of the fire modules in torchvision's ``features``."""


class Fire(nn.Module):  # type: ignore[misc]  # torch is not followed by mypy
    """Fire module: a squeezing 1 x 1 convolution, then 1 x 1 and 3 x 3 convolutions in parallel."""

    def __init__(self, inputs: int, squeezed: int, expanded: int) -> None:
        super().__init__()
        self.squeeze = nn.Conv2d(inputs, squeezed, 1)
        self.expand1 = nn.Conv2d(squeezed, expanded, 1)
        self.expand3 = nn.Conv2d(squeezed, expanded, 3, padding=1)

    def forward(self, values: torch.Tensor) -> torch.Tensor:
        """(N, inputs, H, W) to (N, 2 expanded, H, W)."""
        squeezed = torch.relu(self.squeeze(values))
        return torch.relu(torch.cat([self.expand1(squeezed), self.expand3(squeezed)], dim=1))


class SqueezeNet(nn.Module):  # type: ignore[misc]
    """SqueezeNet 1.1 (Iandola et al. 2016), 1,235,496 parameters, with dropout before its last convolution.

    ``of_torchvision``: the weights were trained on 224 x 224 RGB pixels with ImageNet's channel means and deviations,
    otherwise on the authors' 227 x 227 BGR pixels.
    """

    def __init__(self, *, of_torchvision: bool) -> None:
        super().__init__()
        self._of_torchvision = of_torchvision
        self.input_size = 224 if of_torchvision else 227
        self.conv1 = nn.Conv2d(3, 64, 3, stride=2)
        self.fires = nn.ModuleList([Fire(*width) for width in FIRES])
        self.conv10 = nn.Conv2d(512, NUM_CLASSES, 1)
        self.pool = nn.MaxPool2d(3, stride=2, ceil_mode=True)
        self.dropout = nn.Dropout(0.5)

    def trunk(self, images: torch.Tensor) -> torch.Tensor:
        """(N, 512, H, W) map of (N, 3, size, size) images."""
        values = self.pool(torch.relu(self.conv1(images)))
        for number, fire in enumerate(self.fires):
            values = self.pool(values) if number in (2, 4) else values
            values = fire(values)
        return values

    def head(self) -> nn.Sequential:
        """Dropout, the last convolution and the mean over its map, (N, 512, H, W) to (N, 1000)."""
        return nn.Sequential(self.dropout, self.conv10, nn.ReLU(), nn.AdaptiveAvgPool2d(1), nn.Flatten())

    def appearance(self, images: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """The descriptors, and their (N, 512) means over the map."""
        descriptors = self.trunk(images)
        return descriptors, descriptors.mean(dim=(2, 3))

    def normalise(self, crops: Bytes) -> torch.Tensor:
        """(N, size, size, 3) RGB bytes normalised as in the training of the weights."""
        if self._of_torchvision:
            return normalised(crops, (0.485, 0.456, 0.406), (0.229, 0.224, 0.225))
        values = crops[..., ::-1].astype(np.float32) - np.array(MEAN_BGR, dtype=np.float32)
        return torch.from_numpy(np.ascontiguousarray(values.transpose(0, 3, 1, 2)))

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        """(N, 1000) logits of (N, 3, size, size) images."""
        logits: torch.Tensor = self.head()(self.trunk(images))
        return logits


def is_of_torchvision(names: set[str]) -> bool:
    """Whether a state dict with these names has torchvision's layout."""
    return any(name.startswith("features.") for name in names)


def renamed(name: str) -> str:
    """Convert a state-dict name from torchvision's layout to this module's; other names are unchanged."""
    fire = re.fullmatch(r"features\.(\d+)\.(squeeze|expand1|expand3)(?:x[13])?\.(weight|bias)", name)
    if fire and int(fire[1]) in FIRES_OF_TORCHVISION:
        return f"fires.{FIRES_OF_TORCHVISION.index(int(fire[1]))}.{fire[2]}.{fire[3]}"
    return name.replace("features.0.", "conv1.").replace("classifier.1.", "conv10.")
