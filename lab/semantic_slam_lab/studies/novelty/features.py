"""What a network's trunk makes of the photographs in random rooms, and of pictures of nothing known."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from semantic_slam.configuration import PerceptionConfiguration
from semantic_slam.geometry.arrays import Array, Bytes, Index
from semantic_slam.perception.networks.mc_dropout import probe_features, trunk_features
from semantic_slam.perception.networks.network import DropoutNetwork
from semantic_slam.perception.networks.weights import load_network
from semantic_slam.training.augmentation import room_crop
from semantic_slam.training.latent.views.view_crops import plain_crops
from semantic_slam.training.viewpoint.fit import other_features
from semantic_slam.training.views import ObjectView
from semantic_slam_lab.repetitions import keyed_generator, repeat
from semantic_slam_lab.studies.novelty.pictures import coloured_blocks, noise
from semantic_slam_lab.studies.real_turntables.photographs import TRAIN_STEP_DEG, Photographs
from semantic_slam_lab.studies.real_turntables.trunk import frozen_trunk, trunk_settings

SHIPPED, IMAGENET = "shipped", "imagenet"
NETWORKS = (SHIPPED, IMAGENET)
ALONE, ROOMS = "alone", "rooms"
DRAWS = {ALONE: 1, ROOMS: 2}
"""Setting -> crops of a fitted view: alone on grey, or each in a random room of its own."""
VIEWS_PER_TASK = 40
TESTED_STEP_DEG = 2 * TRAIN_STEP_DEG

Crop = Callable[[int, np.random.Generator], Bytes]
OTHERS: dict[str, Crop] = {"noise": noise, "blocks": coloured_blocks}
"""Pictures without an object."""


@dataclass(frozen=True)
class Views:
    """N crops of the photographs by K features."""

    features: Array  # (N, K)
    instance: Index  # (N,) number of the object
    direction: Index  # (N,) number of the direction of view, in steps of TRAIN_STEP_DEG


@dataclass(frozen=True)
class Measured:
    """All crops of one network in one setting; tested views of all objects lie half a step from the fitted ones."""

    fitted: Views
    tested: Views
    others: dict[str, Array]  # (N, K) by kind
    made_up: Array  # (N, K) of the things that the fit has for comparison
    probe: Array  # (K,)


def measured(
    photographs: Photographs, name: str, data: Path, num_others: int, num_made_up: int, jobs: int
) -> dict[str, Measured]:
    """Features by the network ``name`` in every setting, with as many pictures of every kind without an object."""
    fitted = np.concatenate([photographs.training(own) for own in photographs.names])
    tested = np.flatnonzero([view.angle_deg % TESTED_STEP_DEG == TRAIN_STEP_DEG // 2 for view in photographs.views])
    network = _network(name, data)
    made_up, probe = other_features(network, num_made_up), probe_features(network)
    others = {
        kind: trunk_features(network, np.array([make(network.input_size, _key(kind, n)) for n in range(num_others)]))
        for kind, make in OTHERS.items()
    }
    return {
        setting: Measured(
            fitted=_seen(photographs, np.tile(fitted, draws), name, setting, data, jobs),
            tested=_seen(photographs, tested, name, setting, data, jobs),
            others=others,
            made_up=made_up,
            probe=probe,
        )
        for setting, draws in DRAWS.items()
    }


def _seen(photographs: Photographs, rows: Index, name: str, setting: str, data: Path, jobs: int) -> Views:
    tasks = [
        (name, setting, data, [(photographs.views[row], place) for place, row in block])
        for block in _blocks(list(enumerate(rows.tolist())))
    ]
    found = repeat(_features, tasks, jobs, f"{name}, {setting}: views")
    angles = np.array([photographs.views[row].angle_deg for row in rows])
    return Views(np.concatenate(found), photographs.instance[rows], angles // TRAIN_STEP_DEG)


def _blocks(rows: list[tuple[int, int]]) -> list[list[tuple[int, int]]]:
    return [rows[start : start + VIEWS_PER_TASK] for start in range(0, len(rows), VIEWS_PER_TASK)]


def _features(name: str, setting: str, data: Path, views: list[tuple[ObjectView, int]]) -> Array:
    network = _network(name, data)
    size = network.input_size
    if setting == ALONE:
        return trunk_features(network, plain_crops([view for view, _ in views], size))
    crops = [room_crop(view, size, _key("room", view.class_name, view.angle_deg, place)) for view, place in views]
    return trunk_features(network, np.array(crops))


def _network(name: str, data: Path) -> DropoutNetwork:
    """The network that the package ships, or the one of ImageNet that there is."""
    if name == IMAGENET:
        return frozen_trunk(trunk_settings(data))
    torch.set_num_threads(1)
    return load_network(PerceptionConfiguration()).network


def _key(*key: str | int) -> np.random.Generator:
    return keyed_generator("novelty", *key)
