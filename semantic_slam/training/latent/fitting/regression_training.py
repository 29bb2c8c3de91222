"""Fitting the extractor to given targets of its training crops."""

import numpy as np
import torch

from semantic_slam.geometry.arrays import Array, Bytes, Index
from semantic_slam.latent.extractor import FeatureExtractor
from semantic_slam.training.latent.fitting.gradient_descent import descend, num_batches, shuffled


def fit_extractor(
    crops: Bytes, targets: Array, epochs: int, seed: int, batch_size: int = 128, learning_rate: float = 2e-3
) -> FeatureExtractor:
    """An extractor whose features of (N, size, size, 3) crops come close to the (N, K) targets, in squares."""
    torch.set_num_threads(1)
    torch.manual_seed(seed)
    extractor = FeatureExtractor(targets.shape[1])
    extractor.to(memory_format=torch.channels_last)
    wanted = torch.from_numpy(targets.astype(np.float32))
    generator = np.random.default_rng((seed, 3))

    def loss_of(rows: Index) -> torch.Tensor:
        return ((extractor(extractor.normalise(crops[rows])) - wanted[rows]) ** 2).mean()

    batches, total = shuffled(len(crops), batch_size, epochs, generator), epochs * num_batches(len(crops), batch_size)
    groups = [{"params": extractor.parameters(), "lr": learning_rate}]
    descend(groups, loss_of, batches, total, "extractor", weight_decay=1e-3)
    extractor.eval()
    extractor.requires_grad_(False)
    return extractor
