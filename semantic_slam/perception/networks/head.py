"""A head for classes of one's own on the frozen trunk of an ImageNet network, with dropout in the head alone."""

from pathlib import Path

import numpy as np
import torch
from torch import nn

from semantic_slam.errors import InputError
from semantic_slam.geometry.arrays import Bytes
from semantic_slam.model_files import ModelFormat
from semantic_slam.perception.networks.digest import weights_digest
from semantic_slam.perception.networks.network import ClassifierNetwork, DropoutNetwork, each_alone
from semantic_slam.perception.networks.weight_files import load_strictly

HIDDEN = 64
DROPOUT = 0.5
FORMAT = ModelFormat(
    kind="classifier_head",
    schema_version=1,
    remedy="check perception.head, or train one with semantic_slam train classifier --config",
)
TRUNK = "trunk_sha256"
"""Key of the digest of the network that the head was trained on."""


class Head(nn.Module):  # type: ignore[misc]  # torch is not followed by mypy
    """One hidden layer behind dropout, from K features of a trunk to C logits.

    The features are square roots of the trunk's pooled ones, so that the strongest channels do not hide all others.
    They are standardised by the mean (K,) of the training features and by one scale for all.
    """

    def __init__(self, num_features: int, num_classes: int) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(num_features))
        self.register_buffer("scale", torch.ones(()))
        self.layers = nn.Sequential(
            nn.Dropout(DROPOUT),
            nn.Linear(num_features, HIDDEN),
            nn.ReLU(),
            nn.Dropout(DROPOUT),
            nn.Linear(HIDDEN, num_classes),
        )

    def standardised(self, roots: torch.Tensor) -> torch.Tensor:
        """(N, K) input of the layers, from (N, K) square roots of pooled features."""
        return (roots - self.mean) / self.scale

    def head(self) -> nn.Sequential:
        """The layers with dropout, (N, K) to (N, C)."""
        return self.layers


class NetworkWithHead(nn.Module):  # type: ignore[misc]
    """A frozen network whose own last layers give way to a head."""

    def __init__(self, network: DropoutNetwork, own_head: Head) -> None:
        super().__init__()
        self.network, self.own_head = network, own_head
        self.input_size = network.input_size

    def trunk(self, images: torch.Tensor) -> torch.Tensor:
        """(N, K) standardised features of (N, 3, size, size) images."""
        return self.appearance(images)[0]

    def head(self) -> nn.Sequential:
        """Layers of the head, (N, K) to (N, C)."""
        return self.own_head.head()

    def appearance(self, images: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """The standardised features, and the (N, K) pooled features of the trunk."""
        _, pooled = self.network.appearance(images)
        return self.own_head.standardised(signed_roots(pooled)), pooled

    def normalise(self, crops: Bytes) -> torch.Tensor:
        """(N, size, size, 3) RGB bytes as the frozen network takes them."""
        return self.network.normalise(crops)


def signed_roots(values: torch.Tensor) -> torch.Tensor:
    """Square roots of the absolute values, with the sign of the values."""
    return torch.sign(values) * torch.sqrt(torch.abs(values))


def with_head(network: DropoutNetwork, head: Head, class_names: tuple[str, ...]) -> ClassifierNetwork:
    """The network under a head, in evaluation mode, with the head's (C,) classes."""
    whole = NetworkWithHead(network, head)
    whole.eval()
    return ClassifierNetwork(whole, class_names, each_alone(tuple(range(len(class_names)))))


def save_head(classifier: ClassifierNetwork, provenance: dict[str, object], path: Path) -> None:
    """Write the head of ``with_head`` alone, with its classes and the digest of the network below it."""
    whole = classifier.network
    assert isinstance(whole, NetworkWithHead)
    arrays = {name: np.ascontiguousarray(tensor.numpy()) for name, tensor in whole.own_head.state_dict().items()}
    description = {"class_names": list(classifier.class_names), TRUNK: weights_digest(whole.network)}
    FORMAT.write(path, arrays, description | provenance)


def load_head(path: Path, network: DropoutNetwork) -> ClassifierNetwork:
    """The network under the head of a file that ``save_head`` wrote.

    Raises InputError, also for a head that was trained on another network.
    """
    arrays, description = FORMAT.read(path)
    if description.get(TRUNK) != weights_digest(network):
        raise InputError(
            f"{path}: trained on another network than perception.architecture and perception.network name; correct"
            " these, or train it anew with semantic_slam train classifier --config"
        )
    class_names = tuple(str(name) for name in description.get("class_names", ()))
    head = Head(np.size(arrays.get("mean", ())), len(class_names))
    load_strictly(head, {name: torch.from_numpy(array) for name, array in arrays.items()}, path)
    return with_head(network, head, class_names)
