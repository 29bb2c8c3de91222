"""The semantic measurement: a five-way head with dropout on the frozen trunk, that knows the front views only."""

from dataclasses import dataclass

import numpy as np
import torch
from torch import nn

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.perception.networks.mc_dropout import samples_of_head
from semantic_slam_lab.repetitions import keyed_generator

HIDDEN = 64
DROPOUT = 0.5
STEPS = 150
LEARNING_RATE, WEIGHT_DECAY, LABEL_SMOOTHING = 2e-3, 1e-2, 0.05
NUM_PASSES = 50


@dataclass(frozen=True)
class Head:
    """Layers behind the trunk's pooled features, as a network that Monte Carlo dropout can run."""

    mean: Array  # (K,) of the training features
    scale: float
    layers: nn.Sequential

    def head(self) -> nn.Sequential:
        """The layers with dropout."""
        return self.layers

    def samples(self, feature: Array, key: tuple[str | int, ...]) -> Array:
        """(T, 5) class probabilities of a (K,) pooled feature, one row per dropout pass."""
        descriptor = torch.from_numpy((feature - self.mean) / self.scale).float()[None]
        generator = keyed_generator("real_turntables", "dropout", *key)
        return samples_of_head(self, descriptor, NUM_PASSES, generator)  # type: ignore[arg-type]  # no trunk is run


def trained_head(pooled: Array, labels: Index, num_classes: int, seed: int) -> Head:
    """Fitted to (N, K) features of front views and (N,) labels by cross entropy, all at once in every step."""
    torch.set_num_threads(1)
    torch.manual_seed(seed)
    mean, scale = pooled.mean(axis=0), float(pooled.std())
    layers = nn.Sequential(
        nn.Dropout(DROPOUT),
        nn.Linear(pooled.shape[1], HIDDEN),
        nn.ReLU(),
        nn.Dropout(DROPOUT),
        nn.Linear(HIDDEN, num_classes),
    )
    optimiser = torch.optim.AdamW(layers.parameters(), lr=LEARNING_RATE, weight_decay=WEIGHT_DECAY)
    inputs, wanted = torch.from_numpy((pooled - mean) / scale).float(), torch.from_numpy(np.asarray(labels))
    loss_function = nn.CrossEntropyLoss(label_smoothing=LABEL_SMOOTHING)
    for _ in range(STEPS):
        optimiser.zero_grad()
        loss_function(layers(inputs), wanted).backward()
        optimiser.step()
    layers.eval()
    layers.requires_grad_(False)
    return Head(mean, scale, layers)
