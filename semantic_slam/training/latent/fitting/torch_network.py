"""The networks of the model while they are trained; afterwards they are plain numpy (smooth_network.py)."""

from itertools import pairwise

import numpy as np
import torch
from torch import nn

from semantic_slam.geometry.arrays import Array
from semantic_slam.latent.smooth_network import Layer, SmoothNetwork


def tanh_network(sizes: tuple[int, ...]) -> nn.Sequential:
    """Linear layers of the given sizes with tanh between them."""
    layers: list[nn.Module] = []
    for inputs, outputs in pairwise(sizes):
        layers += [nn.Linear(inputs, outputs), nn.Tanh()]
    return nn.Sequential(*layers[:-1])


def exported(network: nn.Sequential) -> SmoothNetwork:
    """A torch network as the same function without torch."""
    linear = [layer for layer in network if isinstance(layer, nn.Linear)]
    return SmoothNetwork([Layer(_array(layer.weight), _array(layer.bias)) for layer in linear])


def imported(network: SmoothNetwork) -> nn.Sequential:
    """A smooth network as a torch network that can be trained further."""
    sizes = (network.num_inputs, *(len(layer.bias) for layer in network.layers))
    result = tanh_network(sizes)
    linear = [layer for layer in result if isinstance(layer, nn.Linear)]
    with torch.no_grad():
        for target, source in zip(linear, network.layers, strict=True):
            target.weight.copy_(torch.from_numpy(source.weight))
            target.bias.copy_(torch.from_numpy(source.bias))
    return result


def _array(tensor: torch.Tensor) -> Array:
    return np.array(tensor.detach().double().numpy())
