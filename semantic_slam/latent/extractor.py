"""Feature extractor f_psi (Eq. 5.6): from a detector's crop, background included, to a short vector."""

import numpy as np
import torch
from torch import nn

from semantic_slam.geometry.arrays import Array, Bytes
from semantic_slam.perception.networks.network import centred, convolution

BLOCK = 512
"""Batch size: number of crops per forward pass."""


class FeatureExtractor(nn.Module):  # type: ignore[misc]  # torch is not followed by mypy
    """Network of four convolutions and two linear layers, from a crop to F features."""

    input_size = 32

    def __init__(self, num_features: int) -> None:
        super().__init__()
        self.trunk = nn.Sequential(
            *convolution(3, 24, 5, stride=2),
            *convolution(24, 48, 3, stride=2),
            *convolution(48, 96, 3),
            *convolution(96, 96, 3, stride=2),
            nn.Flatten(),
            nn.Linear(96 * 4 * 4, 256),
            nn.ReLU(),
        )
        self.head = nn.Linear(256, num_features)

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        """(N, 3, size, size) normalised images to (N, F)."""
        features: torch.Tensor = self.head(self.trunk(images))
        return features

    def normalise(self, crops: Bytes) -> torch.Tensor:
        """(N, size, size, 3) RGB bytes to about zero mean and unit spread."""
        return centred(crops)

    def features(self, crops: Bytes) -> Array:
        """(N, F) of (N, size, size, 3) RGB bytes."""
        with torch.inference_mode():
            blocks = [
                self(self.normalise(crops[start : start + BLOCK])).numpy() for start in range(0, len(crops), BLOCK)
            ]
        return np.asarray(np.concatenate(blocks), dtype=np.float64) if blocks else np.zeros((0, self.num_features))

    @property
    def num_features(self) -> int:
        return int(self.head.out_features)

    def project(self, matrix: Array, offset: Array) -> None:
        """Replace the output f by matrix @ (f - offset) from now on: (F', F) and (F,)."""
        weight, bias = self.head.weight.detach().double().numpy(), self.head.bias.detach().double().numpy()
        self.head = nn.Linear(weight.shape[1], len(matrix))
        with torch.no_grad():
            self.head.weight.copy_(torch.from_numpy(matrix @ weight))
            self.head.bias.copy_(torch.from_numpy(matrix @ (bias - offset)))
