"""Monte Carlo dropout: the trunk once, the head T times in one batch, every draw keyed."""

import hashlib

import numpy as np
import torch
from torch import nn

from semantic_slam.geometry.arrays import Array, Bytes
from semantic_slam.perception.network import DropoutNetwork


def dropout_generator(seed: int, stamp_ns: int, detection_index: int) -> np.random.Generator:
    """Generator of one detection's dropout masks.

    It depends on nothing else, so that neither the other detections of the frame nor the process matters.
    """
    text = f"dropout:{seed}:{stamp_ns}:{detection_index}"
    digest = hashlib.blake2b(text.encode(), digest_size=16).digest()
    return np.random.Generator(np.random.Philox(key=int.from_bytes(digest, "little")))


def class_probability_samples(
    network: DropoutNetwork, crop: Bytes, num_passes: int, generator: np.random.Generator
) -> Array:
    """(T, C) class probabilities of one (size, size, 3) crop, one row per dropout pass.

    One detection at a time: a matrix product over several detections rounds differently with their number.
    """
    with torch.inference_mode():
        descriptor = network.trunk(network.normalise(crop[None]))
        logits = _head_with_dropout(network.head(), descriptor.expand(num_passes, -1), generator)
        return np.asarray(torch.softmax(logits.double(), dim=-1).numpy())


def _head_with_dropout(head: nn.Sequential, values: torch.Tensor, generator: np.random.Generator) -> torch.Tensor:
    """(T, K) to (T, C): what the head computes in training mode, with masks from ``generator``."""
    for layer in head:
        values = _dropped(values, layer.p, generator) if isinstance(layer, nn.Dropout) else layer(values)
    return values


def _dropped(values: torch.Tensor, probability: float, generator: np.random.Generator) -> torch.Tensor:
    kept = generator.random(tuple(values.shape), dtype=np.float32) >= probability
    return values * torch.from_numpy(kept.astype(np.float32) / np.float32(1.0 - probability))
