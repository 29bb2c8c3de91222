"""Monte Carlo dropout: the trunk runs once, the head T times in one batch, with reproducible masks."""

import hashlib
from dataclasses import dataclass

import numpy as np
import torch
from torch import nn

from semantic_slam.geometry.arrays import Array, Bytes
from semantic_slam.perception.networks.network import DropoutNetwork

LEAST_WEIGHTS = 1_000_000
"""Number of weights above which a fully connected layer takes longer than 1 ms."""


def dropout_generator(seed: int, stamp_ns: int, detection_index: int) -> np.random.Generator:
    """Random generator of one detection's dropout masks.

    It depends on the arguments alone: neither other detections of the frame nor the process matter.
    """
    text = f"dropout:{seed}:{stamp_ns}:{detection_index}"
    digest = hashlib.blake2b(text.encode(), digest_size=16).digest()
    return np.random.Generator(np.random.Philox(key=int.from_bytes(digest, "little")))


@dataclass(frozen=True)
class Seen:
    """Trunk output of an image, shared by all dropout passes; the trunk has no dropout."""

    descriptor: torch.Tensor  # (1, ...) input of the head
    appearance: Array  # (K,) non-negative means over the trunk's maps


def class_probability_samples(
    network: DropoutNetwork, crop: Bytes, num_passes: int, generator: np.random.Generator
) -> Array:
    """(T, C) class probabilities of one (size, size, 3) crop, one row per dropout pass."""
    with torch.inference_mode():
        descriptor = network.trunk(network.normalise(crop[None]))
    return samples_of_head(network, descriptor, num_passes, generator)


def seen(network: DropoutNetwork, crop: Bytes) -> Seen:
    """Run the trunk on one (size, size, 3) crop.

    Crops are run one at a time: the rounding of a batched matrix product depends on the batch size.
    """
    with torch.inference_mode():
        descriptor, appearance = network.appearance(network.normalise(crop[None]))
        return Seen(descriptor, np.asarray(appearance[0].double().numpy()))


def samples_of_head(
    network: DropoutNetwork, descriptor: torch.Tensor, num_passes: int, generator: np.random.Generator
) -> Array:
    """(T, C) class probabilities of the head for a (1, ...) descriptor, one row per dropout pass."""
    with torch.inference_mode():
        passes = descriptor.expand(num_passes, *descriptor.shape[1:])
        logits = _head_with_dropout(network.head(), passes, generator)
        return np.asarray(torch.softmax(logits.double(), dim=-1).numpy())


def trunk_features(network: DropoutNetwork, crops: Bytes) -> Array:
    """(N, K) class-independent features of (N, size, size, 3) RGB crops: non-negative means over trunk maps."""
    rows = [seen(network, crop).appearance for crop in crops]
    return np.array(rows) if rows else np.zeros((0, 0))


def probe_features(network: DropoutNetwork) -> Array:
    """(K,) features of a fixed synthetic probe image (a colour fan), which identify a network."""
    ramp = np.linspace(0.0, 255.0, network.input_size)
    columns, rows = np.meshgrid(ramp, ramp)
    picture = np.stack([columns, rows, (columns * rows / 255.0 * 7.0) % 256.0], axis=-1)
    return seen(network, picture.astype(np.uint8)).appearance


def _head_with_dropout(head: nn.Sequential, values: torch.Tensor, generator: np.random.Generator) -> torch.Tensor:
    """Run the head in training mode, (T, ...) to (T, C), with dropout masks from ``generator``."""
    for layer in head:
        values = _dropped(values, layer.p, generator) if isinstance(layer, nn.Dropout) else _applied(layer, values)
    return values


def _applied(layer: nn.Module, values: torch.Tensor) -> torch.Tensor:
    """Apply one layer to (T, ...) values.

    Products with many weights use oneDNN, as convolutions do anyway: where torch's BLAS is MKL and the processor is not
    Intel's, oneDNN takes half the time for tens of rows. Both work in float32 but sum in a different order.
    """
    if not isinstance(layer, nn.Linear) or layer.weight.numel() < LEAST_WEIGHTS or not _has_onednn():
        return layer(values)
    return torch.ops.mkldnn._linear_pointwise(values, layer.weight, layer.bias, "none", [], "")


def _has_onednn() -> bool:
    return bool(torch.backends.mkldnn.is_available()) and hasattr(torch.ops.mkldnn, "_linear_pointwise")


def _dropped(values: torch.Tensor, probability: float, generator: np.random.Generator) -> torch.Tensor:
    kept = generator.random(tuple(values.shape), dtype=np.float32) >= probability
    return values * torch.from_numpy(kept.astype(np.float32) / np.float32(1.0 - probability))
