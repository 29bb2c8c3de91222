"""Interface of classification networks: a trunk that runs once, and a head with dropout."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch
from torch import nn

from semantic_slam.geometry.arrays import Array, Bytes


class DropoutNetwork(Protocol):
    """A network whose dropout layers all come after its convolutional trunk.

    Only then may the trunk run once for many dropout passes without changing the output distribution.
    """

    input_size: int  # pixels, crops are input_size x input_size

    def trunk(self, images: torch.Tensor) -> torch.Tensor:
        """(N, 3, size, size) normalised images to (N, ...) descriptors; deterministic."""

    def head(self) -> nn.Sequential:
        """Layers from a descriptor to the logits; its nn.Dropout layers are the source of model uncertainty."""

    def appearance(self, images: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """The descriptors, and (N, K) appearance features of the images: non-negative means over trunk maps."""

    def normalise(self, crops: Bytes) -> torch.Tensor:
        """(N, size, size, 3) RGB bytes to the (N, 3, size, size) input of the trunk."""

    def state_dict(self) -> dict[str, torch.Tensor]:
        """Weights by name, as of any torch module."""


@dataclass(frozen=True)
class ClassifierNetwork:
    """A loaded network and the meaning of its outputs."""

    network: DropoutNetwork
    class_names: tuple[str, ...]  # (C,) names of the classes that are reported
    members: tuple[tuple[int, ...], ...]  # (C,) network outputs whose probabilities each class sums

    def reported(self, probabilities: Array) -> Array:
        """(..., C) probabilities of the reported classes from (..., outputs) network probabilities."""
        return np.stack([probabilities[..., list(outputs)].sum(axis=-1) for outputs in self.members], axis=-1)


def each_alone(outputs: tuple[int, ...]) -> tuple[tuple[int, ...], ...]:
    """``members`` of classes that consist of one output each."""
    return tuple((index,) for index in outputs)


def normalised(crops: Bytes, mean: tuple[float, ...], scale: tuple[float, ...]) -> torch.Tensor:
    """(N, H, W, 3) bytes to (N, 3, H, W) float32, (value / 255 - mean) / scale per channel."""
    images = torch.from_numpy(np.ascontiguousarray(crops)).permute(0, 3, 1, 2).to(torch.float32) / 255.0
    shift = torch.tensor(mean).view(1, 3, 1, 1)
    return ((images - shift) / torch.tensor(scale).view(1, 3, 1, 1)).contiguous()


def centred(crops: Bytes) -> torch.Tensor:
    """(N, H, W, 3) bytes to (N, 3, H, W) float32 of about zero mean and unit spread, for networks trained here."""
    return normalised(crops, (0.5, 0.5, 0.5), (0.25, 0.25, 0.25))


def convolution(inputs: int, outputs: int, kernel: int, stride: int = 1) -> list[nn.Module]:
    """A convolution that keeps the size of maps, divided by ``stride``, and the ReLU after it."""
    return [nn.Conv2d(inputs, outputs, kernel, stride=stride, padding=kernel // 2), nn.ReLU()]
