"""Training of the compact network on turntable views."""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn
from tqdm import tqdm

from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Bytes
from semantic_slam.perception.networks.compact_network import CompactNetwork
from semantic_slam.perception.networks.network import DropoutNetwork
from semantic_slam.training.augmentation import room_crop
from semantic_slam.training.views import ObjectView

Labels = NDArray[np.int64]

HELD_OUT_PERIOD = 5
"""Angles of a class of which one is held out."""


@dataclass(frozen=True)
class TrainingConfiguration:
    """How a network is trained; the defaults are those of the shipped one."""

    epochs: int = 14
    crops_per_epoch: int = 4000
    batch_size: int = 128
    learning_rate: float = 2e-3
    weight_decay: float = 1e-3
    label_smoothing: float = 0.05
    largest_azimuth_rad: float = 1.9  # views further round the back are not shown: there the classes stay confusable
    seed: int = 0


def train(
    views: Sequence[ObjectView], class_names: tuple[str, ...], configuration: TrainingConfiguration
) -> CompactNetwork:
    """Network trained on the front views; deterministic on one machine for one seed.

    Raises InputError where a class has no front views.
    """
    torch.set_num_threads(1)
    torch.manual_seed(configuration.seed)
    shown = shown_views(views, class_names, configuration)
    network = CompactNetwork(len(class_names))
    network.to(memory_format=torch.channels_last)  # faster on a CPU
    optimiser = torch.optim.AdamW(
        network.parameters(), lr=configuration.learning_rate, weight_decay=configuration.weight_decay
    )
    steps = -(-configuration.crops_per_epoch // configuration.batch_size)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, configuration.learning_rate, total_steps=configuration.epochs * steps
    )
    loss_function = nn.CrossEntropyLoss(label_smoothing=configuration.label_smoothing)
    generator = np.random.default_rng(configuration.seed)
    progress = tqdm(range(configuration.epochs), desc="training", unit="epoch")
    for _ in progress:
        losses = []
        for crops, labels in drawn_batches(shown, class_names, network.input_size, configuration, generator):
            loss = loss_function(network(network.normalise(crops)), torch.from_numpy(labels))
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            schedule.step()
            losses.append(loss.item())
        progress.set_postfix(loss=f"{np.mean(losses):.3f}")
    network.eval()
    return network


def shown_views(
    views: Sequence[ObjectView], class_names: tuple[str, ...], configuration: TrainingConfiguration
) -> list[ObjectView]:
    """The views near the front. Raises InputError where a class has none."""
    shown = [view for view in views if abs(view.azimuth_rad) <= configuration.largest_azimuth_rad]
    unseen = sorted(set(class_names) - {view.class_name for view in shown})
    if unseen:
        degrees = np.rad2deg(configuration.largest_azimuth_rad)
        raise InputError(
            f"class '{unseen[0]}': no view within {degrees:.0f} degrees of its front; raise --max-azimuth-deg, or"
            " correct the azimuths"
        )
    return shown


def hold_out_angles(views: Sequence[ObjectView]) -> tuple[list[ObjectView], list[ObjectView]]:
    """Views to learn from, and those at every fifth angle of each class, to judge by.

    All views of a class at one angle, from whatever height, go together. Of fewer than five angles none is held out.
    """
    angles_deg: dict[str, set[int]] = defaultdict(set)
    for view in views:
        angles_deg[view.class_name].add(view.angle_deg)
    out = {
        name: set(sorted(own)[HELD_OUT_PERIOD // 2 :: HELD_OUT_PERIOD]) if len(own) >= HELD_OUT_PERIOD else set()
        for name, own in angles_deg.items()
    }
    learned = [view for view in views if view.angle_deg not in out[view.class_name]]
    return learned, [view for view in views if view.angle_deg in out[view.class_name]]


def drawn_batches(
    views: Sequence[ObjectView],
    class_names: tuple[str, ...],
    size: int,
    configuration: TrainingConfiguration,
    generator: np.random.Generator,
) -> Iterator[tuple[Bytes, Labels]]:
    """Batches of (N, size, size, 3) crops and (N,) class indices: each class equally often."""
    of_class = [[view for view in views if view.class_name == name] for name in class_names]
    for start in range(0, configuration.crops_per_epoch, configuration.batch_size):
        count = min(configuration.batch_size, configuration.crops_per_epoch - start)
        labels = generator.integers(len(class_names), size=count)
        chosen = [of_class[label][generator.integers(len(of_class[label]))] for label in labels]
        yield np.stack([room_crop(view, size, generator) for view in chosen]), labels


def accuracy_by_azimuth(
    network: DropoutNetwork, views: Sequence[ObjectView], class_names: tuple[str, ...], seed: int, draws: int = 1
) -> dict[str, float]:
    """Share of right classes, without dropout, for each quarter around the objects."""
    generator = np.random.default_rng((seed, 1))
    right: dict[str, list[bool]] = {"front": [], "left": [], "back": [], "right": []}
    for view in views:
        crops = np.stack([room_crop(view, network.input_size, generator) for _ in range(draws)])
        with torch.inference_mode():
            best = network.head()(network.trunk(network.normalise(crops))).argmax(dim=-1).numpy()
        quarter = tuple(right)[round(view.azimuth_rad / (np.pi / 2.0)) % 4]
        right[quarter].extend(best == class_names.index(view.class_name))
    return {quarter: float(np.mean(values)) for quarter, values in right.items() if values}
