"""Fitting the extractor to given targets of its training crops."""

import numpy as np
import torch
from numpy.typing import NDArray
from tqdm import tqdm

from semantic_slam.latent.extractor import FeatureExtractor

Array = NDArray[np.float64]
Bytes = NDArray[np.uint8]


def fit_extractor(
    crops: Bytes, targets: Array, epochs: int, seed: int, batch_size: int = 128, learning_rate: float = 2e-3
) -> FeatureExtractor:
    """An extractor whose features of (N, size, size, 3) crops come close to the (N, K) targets, in squares."""
    torch.set_num_threads(1)
    torch.manual_seed(seed)
    extractor = FeatureExtractor(targets.shape[1])
    extractor.to(memory_format=torch.channels_last)
    wanted = torch.from_numpy(targets.astype(np.float32))
    optimiser = torch.optim.AdamW(extractor.parameters(), lr=learning_rate, weight_decay=1e-3)
    steps = len(crops) // batch_size
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, learning_rate, total_steps=max(epochs * steps, 1))
    generator = np.random.default_rng((seed, 3))
    progress = tqdm(range(epochs), desc="extractor", unit="epoch")
    for _ in progress:
        order, total = generator.permutation(len(crops)), 0.0
        for step in range(steps):
            rows = order[step * batch_size : (step + 1) * batch_size]
            loss = ((extractor(extractor.normalise(crops[rows])) - wanted[rows]) ** 2).mean()
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            schedule.step()
            total += loss.item()
        progress.set_postfix(loss=f"{total / max(steps, 1):.4f}")
    extractor.eval()
    extractor.requires_grad_(False)
    return extractor
