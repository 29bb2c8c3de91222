"""Scores of photographs: SqueezeNet with true dropout, ImageNet's classes in groups."""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml
from tqdm import tqdm

from semantic_slam.configuration import PerceptionConfiguration
from semantic_slam.geometry.arrays import Array
from semantic_slam.perception.networks.imagenet_networks import load_imagenet_network
from semantic_slam.perception.networks.mc_dropout import class_probability_samples, dropout_generator
from semantic_slam.perception.networks.network import ClassifierNetwork
from semantic_slam.perception.uncertainty import sample_covariance
from semantic_slam_lab.studies.real_cabinet.views import Photograph

GROUPS = {
    "cabinet": [
        *("file", "chiffonier", "wardrobe", "china cabinet", "medicine chest", "bookcase", "safe"),
        *("refrigerator", "washer", "dishwasher", "microwave"),
    ],
    "chair": ["folding chair", "rocking chair", "barber chair", "throne", "studio couch", "park bench"],
    "cup": ["cup", "coffee mug"],
    "tvmonitor": ["monitor", "CRT screen", "television", "desktop computer", "laptop", "notebook"],
    "diningtable": ["dining table", "desk"],
}
"""Class -> ImageNet's classes of that kind, chosen by their names: boxes with doors or drawers, seats, …"""
PASSES, QUICK_PASSES = 50, 8


@dataclass(frozen=True)
class Scores:
    """V views; F reported groups, the rest of ImageNet last."""

    names: tuple[str, ...]  # (F,)
    means: Array  # (V, F) over the dropout passes
    covariances: Array  # (V, F, F)


def squeezenet(weights: Path) -> ClassifierNetwork:
    """The network of a file in the data set. Raises InputError."""
    with tempfile.TemporaryDirectory(prefix="groups_") as folder:
        groups = Path(folder) / "groups.yaml"
        groups.write_text(yaml.safe_dump(GROUPS, sort_keys=False), encoding="utf-8")
        return load_imagenet_network(
            PerceptionConfiguration(network=str(weights), architecture="squeezenet", class_groups=str(groups))
        )


def scores_of(views: Sequence[Photograph], network: ClassifierNetwork, num_passes: int, seed: int) -> Scores:
    """What the network says of every view, each with dropout masks of its own."""
    means, covariances = [], []
    for number, view in enumerate(tqdm(views, desc="network", unit="view")):
        generator = dropout_generator(seed, view.frame, number)
        passes = network.reported(class_probability_samples(network.network, view.crop, num_passes, generator))
        means.append(passes.mean(axis=0))
        covariances.append(sample_covariance(passes[None])[0])
    return Scores(network.class_names, np.array(means), np.array(covariances))
