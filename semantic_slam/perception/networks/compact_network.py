"""The project's own small network: 64 x 64 crops, 653 thousand parameters for five classes."""

import torch
from torch import nn

from semantic_slam.geometry.arrays import Bytes
from semantic_slam.perception.networks.network import centred, convolution

ARCHITECTURE = "compact"


class CompactNetwork(nn.Module):  # type: ignore[misc]  # torch is not followed by mypy
    """Four convolutions, then two hidden layers behind dropout, then C logits."""

    input_size = 64

    def __init__(self, num_classes: int, dropout: float = 0.5) -> None:
        super().__init__()
        self.features = nn.Sequential(
            *convolution(3, 32, 5, stride=2),
            nn.MaxPool2d(2),
            *convolution(32, 64, 5),
            nn.MaxPool2d(2),
            *convolution(64, 96, 3),
            *convolution(96, 96, 3),
            nn.MaxPool2d(2),
        )
        self.classifier = nn.Sequential(
            nn.Dropout(dropout),
            nn.Linear(96 * 4 * 4, 256),
            nn.ReLU(),
            nn.Dropout(dropout),
            nn.Linear(256, 256),
            nn.ReLU(),
            nn.Linear(256, num_classes),
        )

    def trunk(self, images: torch.Tensor) -> torch.Tensor:
        """(N, 1536) activations before the fully connected layers, of (N, 3, 64, 64) images."""
        return torch.flatten(self.features(images), 1)

    def head(self) -> nn.Sequential:
        """Dropout and linear layers, (N, 1536) to (N, C)."""
        return self.classifier

    def appearance(self, images: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """The descriptors, and the (N, 576) means and standard deviations over the maps of the four convolutions.

        The last map alone separates the few classes and little else; novelty shows in earlier maps.
        """
        parts = []
        for layer in self.features:
            images = layer(images)
            if isinstance(layer, nn.ReLU):
                parts += [images.mean(dim=(2, 3)), images.std(dim=(2, 3))]
        return torch.flatten(images, 1), torch.cat(parts, dim=1)

    def normalise(self, crops: Bytes) -> torch.Tensor:
        """(N, 64, 64, 3) RGB bytes to about zero mean and unit spread."""
        return centred(crops)

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        """(N, 3, 64, 64) to (N, C) logits, as training needs it."""
        logits: torch.Tensor = self.classifier(self.trunk(images))
        return logits
