"""Training of a head for classes of one's own on the frozen trunk of an ImageNet network."""

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn
from tqdm import tqdm

from semantic_slam.geometry.arrays import Array, Bytes, Index
from semantic_slam.perception.networks.head import Head, signed_roots, with_head
from semantic_slam.perception.networks.network import ClassifierNetwork, DropoutNetwork
from semantic_slam.training.classifier import TrainingConfiguration, drawn_batches, shown_views
from semantic_slam.training.views import ObjectView

HEAD_TRAINING = TrainingConfiguration(epochs=150, crops_per_epoch=2000, weight_decay=1e-2)
"""Crops are drawn and measured once; every epoch is one step on all of them."""

Features = NDArray[np.float32]


def train_on_trunk(
    views: Sequence[ObjectView],
    class_names: tuple[str, ...],
    network: DropoutNetwork,
    configuration: TrainingConfiguration = HEAD_TRAINING,
) -> ClassifierNetwork:
    """The network under a head trained on the front views; deterministic on one machine for one seed.

    Raises InputError where a class has no front views.
    """
    shown = shown_views(views, class_names, configuration)
    generator = np.random.default_rng(configuration.seed)
    roots, labels = [], []
    with tqdm(total=configuration.crops_per_epoch, desc="measuring crops", unit="crop") as progress:
        for crops, chosen in drawn_batches(shown, class_names, network.input_size, configuration, generator):
            roots.append(trunk_roots(network, crops))
            labels.append(chosen)
            progress.update(len(chosen))
    head = train_head(np.concatenate(roots), np.concatenate(labels), len(class_names), configuration)
    return with_head(network, head, class_names)


def trunk_roots(network: DropoutNetwork, crops: Bytes) -> Features:
    """(N, K) input features of a head, of (N, size, size, 3) RGB crops; one at a time, as a run measures them."""
    with torch.inference_mode():
        rows = [signed_roots(network.appearance(network.normalise(crop[None]))[1][0]).numpy() for crop in crops]
    return np.asarray(rows, dtype=np.float32)


def train_head(roots: Array | Features, labels: Index, num_classes: int, configuration: TrainingConfiguration) -> Head:
    """A head fitted to (N, K) square roots of pooled features and (N,) labels by cross entropy, in evaluation mode."""
    torch.set_num_threads(1)
    torch.manual_seed(configuration.seed)
    head = Head(roots.shape[1], num_classes)
    head.mean.copy_(torch.from_numpy(roots.mean(axis=0)))
    head.scale.fill_(float(roots.std()))
    optimiser = torch.optim.AdamW(
        head.parameters(), lr=configuration.learning_rate, weight_decay=configuration.weight_decay
    )
    inputs, wanted = head.standardised(torch.from_numpy(roots)).float(), torch.from_numpy(np.asarray(labels))
    loss_function = nn.CrossEntropyLoss(label_smoothing=configuration.label_smoothing)
    for _ in range(configuration.epochs):
        optimiser.zero_grad()
        loss_function(head.layers(inputs), wanted).backward()
        optimiser.step()
    head.eval()
    head.requires_grad_(False)
    return head
