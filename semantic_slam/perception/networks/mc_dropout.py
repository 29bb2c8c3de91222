"""Monte Carlo dropout: the trunk once, the head T times in one batch, every draw keyed."""

import hashlib
from dataclasses import dataclass

import numpy as np
import torch
from torch import nn

from semantic_slam.geometry.arrays import Array, Bytes
from semantic_slam.perception.networks.network import DropoutNetwork

LEAST_WEIGHTS = 1_000_000
"""Weights of a fully connected layer from which on its product takes longer than a millisecond."""


def dropout_generator(seed: int, stamp_ns: int, detection_index: int) -> np.random.Generator:
    """Generator of one detection's dropout masks.

    It depends on nothing else, so that neither the other detections of the frame nor the process matters.
    """
    text = f"dropout:{seed}:{stamp_ns}:{detection_index}"
    digest = hashlib.blake2b(text.encode(), digest_size=16).digest()
    return np.random.Generator(np.random.Philox(key=int.from_bytes(digest, "little")))


@dataclass(frozen=True)
class Seen:
    """What the trunk makes of a picture, once for all dropout passes; no dropout lies in it."""

    descriptor: torch.Tensor  # (1, ...) what the head is given
    appearance: Array  # (K,) non-negative means over the trunk's maps


def class_probability_samples(
    network: DropoutNetwork, crop: Bytes, num_passes: int, generator: np.random.Generator
) -> Array:
    """(T, C) class probabilities of one (size, size, 3) crop, one row per dropout pass."""
    with torch.inference_mode():
        descriptor = network.trunk(network.normalise(crop[None]))
    return samples_of_head(network, descriptor, num_passes, generator)


def seen(network: DropoutNetwork, crop: Bytes) -> Seen:
    """What the trunk makes of one (size, size, 3) crop.

    One detection at a time: a matrix product over several detections rounds differently with their number.
    """
    with torch.inference_mode():
        descriptor, appearance = network.appearance(network.normalise(crop[None]))
        return Seen(descriptor, np.asarray(appearance[0].double().numpy()))


def samples_of_head(
    network: DropoutNetwork, descriptor: torch.Tensor, num_passes: int, generator: np.random.Generator
) -> Array:
    """(T, C) class probabilities that the head makes of a (1, ...) descriptor, one row per dropout pass."""
    with torch.inference_mode():
        passes = descriptor.expand(num_passes, *descriptor.shape[1:])
        logits = _head_with_dropout(network.head(), passes, generator)
        return np.asarray(torch.softmax(logits.double(), dim=-1).numpy())


def trunk_features(network: DropoutNetwork, crops: Bytes) -> Array:
    """(N, K) non-negative means over the trunk's maps, of (N, size, size, 3) RGB crops: what is seen, classes apart."""
    rows = [seen(network, crop).appearance for crop in crops]
    return np.array(rows) if rows else np.zeros((0, 0))


def probe_features(network: DropoutNetwork) -> Array:
    """(K,) features of a picture that is the same everywhere, a fan of colours: they tell one network from another."""
    ramp = np.linspace(0.0, 255.0, network.input_size)
    columns, rows = np.meshgrid(ramp, ramp)
    picture = np.stack([columns, rows, (columns * rows / 255.0 * 7.0) % 256.0], axis=-1)
    return seen(network, picture.astype(np.uint8)).appearance


def _head_with_dropout(head: nn.Sequential, values: torch.Tensor, generator: np.random.Generator) -> torch.Tensor:
    """(T, ...) to (T, C): what the head computes in training mode, with masks from ``generator``."""
    for layer in head:
        values = _dropped(values, layer.p, generator) if isinstance(layer, nn.Dropout) else _applied(layer, values)
    return values


def _applied(layer: nn.Module, values: torch.Tensor) -> torch.Tensor:
    """What a layer makes of (T, ...) values.

    Products with many weights are oneDNN's, as convolutions are anyway: where torch's own BLAS is MKL and the processor
    not Intel's, it takes half the time for tens of rows. Both are in float32 and sum in another order.
    """
    if not isinstance(layer, nn.Linear) or layer.weight.numel() < LEAST_WEIGHTS or not _has_onednn():
        return layer(values)
    return torch.ops.mkldnn._linear_pointwise(values, layer.weight, layer.bias, "none", [], "")


def _has_onednn() -> bool:
    return bool(torch.backends.mkldnn.is_available()) and hasattr(torch.ops.mkldnn, "_linear_pointwise")


def _dropped(values: torch.Tensor, probability: float, generator: np.random.Generator) -> torch.Tensor:
    kept = generator.random(tuple(values.shape), dtype=np.float32) >= probability
    return values * torch.from_numpy(kept.astype(np.float32) / np.float32(1.0 - probability))
