"""AlexNet in plain torch, with torchvision's module names, so that its state dicts load strictly."""

import torch
from torch import nn

from semantic_slam.geometry.arrays import Bytes
from semantic_slam.perception.networks.network import normalised

ARCHITECTURE = "alexnet"
NUM_CLASSES = 1000


class AlexNet(nn.Module):  # type: ignore[misc]  # torch is not followed by mypy
    """The one-tower AlexNet for 224 x 224 ImageNet crops, 61,100,840 parameters."""

    input_size = 224

    def __init__(self) -> None:
        super().__init__()
        self.features = nn.Sequential(
            nn.Conv2d(3, 64, 11, stride=4, padding=2),
            nn.ReLU(),
            nn.MaxPool2d(3, 2),
            nn.Conv2d(64, 192, 5, padding=2),
            nn.ReLU(),
            nn.MaxPool2d(3, 2),
            nn.Conv2d(192, 384, 3, padding=1),
            nn.ReLU(),
            nn.Conv2d(384, 256, 3, padding=1),
            nn.ReLU(),
            nn.Conv2d(256, 256, 3, padding=1),
            nn.ReLU(),
            nn.MaxPool2d(3, 2),
        )
        self.avgpool = nn.AdaptiveAvgPool2d((6, 6))
        self.classifier = nn.Sequential(
            nn.Dropout(0.5),
            nn.Linear(9216, 4096),
            nn.ReLU(),
            nn.Dropout(0.5),
            nn.Linear(4096, 4096),
            nn.ReLU(),
            nn.Linear(4096, NUM_CLASSES),
        )

    def trunk(self, images: torch.Tensor) -> torch.Tensor:
        """(N, 9216) activations before the fully connected layers, of (N, 3, 224, 224) images."""
        return torch.flatten(self.avgpool(self.features(images)), 1)

    def head(self) -> nn.Sequential:
        """Dropout and linear layers, (N, 9216) to (N, 1000)."""
        return self.classifier

    def appearance(self, images: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """The descriptors, and their (N, 256) means over the 6 x 6 map."""
        descriptors = self.trunk(images)
        return descriptors, descriptors.unflatten(1, (256, 36)).mean(dim=-1)

    def normalise(self, crops: Bytes) -> torch.Tensor:
        """(N, 224, 224, 3) RGB bytes with ImageNet's channel means and deviations."""
        return normalised(crops, (0.485, 0.456, 0.406), (0.229, 0.224, 0.225))

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        """(N, 1000) logits of (N, 3, 224, 224) images."""
        logits: torch.Tensor = self.classifier(self.trunk(images))
        return logits
