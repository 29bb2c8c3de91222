"""The semantic measurement: a five-way head with dropout on the frozen trunk, that knows the front views only."""

from dataclasses import dataclass, replace

import numpy as np
import torch

from semantic_slam.geometry.arrays import Array, Index
from semantic_slam.perception.networks.head import Head
from semantic_slam.perception.networks.mc_dropout import samples_of_head
from semantic_slam.training.head import HEAD_TRAINING, train_head
from semantic_slam_lab.repetitions import keyed_generator

NUM_PASSES = 50


@dataclass(frozen=True)
class Measurement:
    """A head and the dropout passes through it."""

    head: Head

    def samples(self, feature: Array, key: tuple[str | int, ...]) -> Array:
        """(T, 5) class probabilities of a (K,) pooled feature, one row per dropout pass."""
        descriptor = self.head.standardised(torch.from_numpy(np.asarray(feature, dtype=np.float32)))[None]
        generator = keyed_generator("real_turntables", "dropout", *key)
        return samples_of_head(self.head, descriptor, NUM_PASSES, generator)


def trained_measurement(pooled: Array, labels: Index, num_classes: int, seed: int) -> Measurement:
    """Fitted to (N, K) features of front views and (N,) labels."""
    return Measurement(train_head(pooled, labels, num_classes, replace(HEAD_TRAINING, seed=seed)))
