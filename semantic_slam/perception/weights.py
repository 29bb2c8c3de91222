"""Loading and saving a network's weights. Files are data only: nothing in them is ever executed."""

import json
import pickle
from importlib import resources
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import nn

from semantic_slam.configuration import PerceptionConfiguration
from semantic_slam.errors import InputError
from semantic_slam.perception import alexnet, compact_network
from semantic_slam.perception.network import ClassifierNetwork

SHIPPED_NETWORK = "compact_network.safetensors"
METADATA_KEY = "semantic_slam"


def shipped_file(name: str) -> Path:
    """Path of a file that is installed with the package."""
    return Path(str(resources.files("semantic_slam.weights") / name))


def load_network(configuration: PerceptionConfiguration) -> ClassifierNetwork:
    """The configured network in evaluation mode. Raises InputError naming file, fault and remedy.

    From here on torch uses one thread: two that fight for a core are many times slower than one.
    """
    torch.set_num_threads(1)
    if configuration.architecture == alexnet.ARCHITECTURE:
        return _load_alexnet(configuration)
    path = Path(configuration.network) if configuration.network else shipped_file(SHIPPED_NETWORK)
    return load_compact_network(path)


def load_compact_network(path: Path) -> ClassifierNetwork:
    """Weights written by ``save_compact_network``. Raises InputError."""
    tensors, metadata = _read_safetensors(path)
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
    _load_strictly(network, tensors, path)
    return ClassifierNetwork(network, class_names, tuple(range(len(class_names))))


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
    save_file(tensors, str(path), metadata={METADATA_KEY: json.dumps(description, sort_keys=True)})


def _load_alexnet(configuration: PerceptionConfiguration) -> ClassifierNetwork:
    if not configuration.network:
        raise InputError("perception.network: alexnet has no shipped weights; name a torchvision state dict (.pth)")
    components = configuration.alexnet_components
    if not components or not all(0 <= index < alexnet.NUM_CLASSES for index in components):
        raise InputError(
            f"perception.alexnet_components: {list(components)} must be ImageNet classes 0 to {alexnet.NUM_CLASSES - 1}"
        )
    path = Path(configuration.network)
    tensors = _read_safetensors(path)[0] if path.suffix == ".safetensors" else _read_state_dict(path)
    network = alexnet.AlexNet()
    _load_strictly(network, tensors, path)
    return ClassifierNetwork(network, tuple(f"imagenet_{index}" for index in components), components)


def _read_safetensors(path: Path) -> tuple[dict[str, torch.Tensor], dict[str, str]]:
    try:
        with safe_open(str(path), framework="pt") as file:
            return {name: file.get_tensor(name) for name in file.keys()}, file.metadata() or {}  # noqa: SIM118
    except (OSError, SafetensorError) as fault:
        raise InputError(
            f"{path}: not a readable safetensors file ({_one_line(fault)}); check perception.network"
        ) from None


def _read_state_dict(path: Path) -> dict[str, torch.Tensor]:
    try:
        tensors = torch.load(path, map_location="cpu", weights_only=True)
    except (OSError, RuntimeError, EOFError, pickle.UnpicklingError) as fault:
        reason = _one_line(fault).split(". ")[0]
        raise InputError(f"{path}: not a state dict of plain tensors ({reason}); save one with torch.save") from None
    if not isinstance(tensors, dict) or not all(isinstance(value, torch.Tensor) for value in tensors.values()):
        raise InputError(f"{path}: holds no state dict; save model.state_dict() with torch.save")
    return tensors


def _load_strictly(network: nn.Module, tensors: dict[str, torch.Tensor], path: Path) -> None:
    try:
        network.load_state_dict(tensors, strict=True)
    except RuntimeError as fault:
        reason = _one_line(fault)[:300]
        raise InputError(
            f"{path}: the weights do not fit the network ({reason}); check perception.architecture"
        ) from None
    network.eval()
    network.requires_grad_(False)


def _one_line(fault: BaseException) -> str:
    return " ".join(str(fault).split())
