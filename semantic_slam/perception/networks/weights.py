"""Loading of the configured network: the project's compact network from its file, or an ImageNet one."""

import json
from pathlib import Path

import torch
from safetensors.torch import save
from torch import nn

from semantic_slam.configuration import PerceptionConfiguration
from semantic_slam.errors import InputError
from semantic_slam.perception.networks import compact_network
from semantic_slam.perception.networks.imagenet_networks import NETWORKS, load_imagenet_network
from semantic_slam.perception.networks.network import ClassifierNetwork, each_alone
from semantic_slam.perception.networks.weight_files import load_strictly, read_safetensors, shipped_file

SHIPPED_NETWORK = "compact_network.safetensors"
METADATA_KEY = "semantic_slam"


def load_network(configuration: PerceptionConfiguration) -> ClassifierNetwork:
    """Load the configured network in evaluation mode. Raises InputError naming file, fault and remedy.

    Sets torch to one thread from here on: two threads that share a core are many times slower than one.
    """
    torch.set_num_threads(1)
    if configuration.architecture in NETWORKS:
        return load_imagenet_network(configuration)
    if configuration.head:
        raise InputError(f"perception.head: only for an ImageNet network; set perception.architecture: {min(NETWORKS)}")
    path = Path(configuration.network) if configuration.network else shipped_file(SHIPPED_NETWORK)
    return load_compact_network(path)


def is_shipped(configuration: PerceptionConfiguration) -> bool:
    """Whether the configured network is the one that is installed with the package."""
    return configuration.architecture == compact_network.ARCHITECTURE and not configuration.network


def load_compact_network(path: Path) -> ClassifierNetwork:
    """Load weights written by ``save_compact_network``. Raises InputError."""
    tensors, metadata = read_safetensors(path)
    try:
        description = json.loads(metadata.get(METADATA_KEY, ""))
        class_names = tuple(str(name) for name in description["class_names"])
        architecture, dropout = description["architecture"], float(description["dropout"])
    except (ValueError, KeyError, TypeError):
        raise InputError(
            f"{path}: not written by train_classifier (no description inside); train a network anew"
        ) from None
    if architecture != compact_network.ARCHITECTURE:
        raise InputError(f"{path}: holds the architecture '{architecture}'; set perception.architecture to it")
    network = compact_network.CompactNetwork(len(class_names), dropout)
    load_strictly(network, tensors, path)
    return ClassifierNetwork(network, class_names, each_alone(tuple(range(len(class_names)))))


def save_compact_network(
    network: compact_network.CompactNetwork, class_names: tuple[str, ...], provenance: dict[str, object], path: Path
) -> None:
    """Write weights, class names and provenance to one safetensors file."""
    dropout = next(layer.p for layer in network.head() if isinstance(layer, nn.Dropout))
    description = {
        "architecture": compact_network.ARCHITECTURE,
        "class_names": list(class_names),
        "dropout": dropout,
        "input_size": network.input_size,
        **provenance,
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    tensors = {name: tensor.contiguous() for name, tensor in network.state_dict().items()}
    path.write_bytes(save(tensors, {METADATA_KEY: json.dumps(description, sort_keys=True)}))
