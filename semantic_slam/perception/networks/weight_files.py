"""Weight files: data only; loading executes no code from them."""

import pickle
from importlib import resources
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from torch import nn

from semantic_slam.errors import InputError, one_line

Tensors = dict[str, torch.Tensor]


def shipped_file(name: str) -> Path:
    """Path of a file that is installed with the package."""
    return Path(str(resources.files("semantic_slam.weights") / name))


def read_weights(path: Path) -> Tensors:
    """The state dict in a safetensors file, or in one that torch.save wrote. Raises InputError."""
    return read_safetensors(path)[0] if path.suffix == ".safetensors" else _read_state_dict(path)


def read_safetensors(path: Path) -> tuple[Tensors, dict[str, str]]:
    """Tensors and metadata. Raises InputError."""
    try:
        with safe_open(str(path), framework="pt") as file:
            return {name: file.get_tensor(name) for name in file.keys()}, file.metadata() or {}  # noqa: SIM118
    except (OSError, SafetensorError) as fault:
        raise InputError(
            f"{path}: not a readable safetensors file ({one_line(fault)}); check perception.network"
        ) from None


def load_strictly(network: nn.Module, tensors: Tensors, path: Path) -> None:
    """Load tensors, set evaluation mode, disable gradients.

    Raises InputError where names or shapes do not match, and for numbers that are not finite.
    """
    try:
        network.load_state_dict(tensors, strict=True)
    except RuntimeError as fault:
        reason = one_line(fault, 300)
        raise InputError(
            f"{path}: the weights do not fit the network ({reason}); check perception.architecture"
        ) from None
    for name, tensor in network.state_dict().items():
        if not tensor.isfinite().all():
            raise InputError(f"{path}: the weights '{name}' are not finite; train them anew, or get the file anew")
    network.eval()
    network.requires_grad_(False)


def _read_state_dict(path: Path) -> Tensors:
    try:
        tensors = torch.load(path, map_location="cpu", weights_only=True)
    except (OSError, RuntimeError, EOFError, pickle.UnpicklingError) as fault:
        reason = one_line(fault).split(". ")[0]
        raise InputError(f"{path}: not a state dict of plain tensors ({reason}); save one with torch.save") from None
    if not isinstance(tensors, dict) or not all(
        isinstance(name, str) and isinstance(value, torch.Tensor) for name, value in tensors.items()
    ):
        raise InputError(f"{path}: holds no state dict; save model.state_dict() with torch.save")
    return tensors
