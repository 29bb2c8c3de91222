"""Networks pre-trained on ImageNet, loaded from weight files in their original layouts."""

from collections.abc import Callable
from pathlib import Path

from semantic_slam.configuration import PerceptionConfiguration
from semantic_slam.errors import InputError
from semantic_slam.perception.networks import alexnet, efficientnet_lite, squeezenet
from semantic_slam.perception.networks.head import load_head
from semantic_slam.perception.networks.imagenet import NUM_CLASSES, reported_classes
from semantic_slam.perception.networks.network import ClassifierNetwork, DropoutNetwork, each_alone
from semantic_slam.perception.networks.weight_files import load_strictly, read_weights


def load_imagenet_network(settings: PerceptionConfiguration) -> ClassifierNetwork:
    """Load the configured network of ``NETWORKS`` with its reported classes, or under a head. Raises InputError."""
    if settings.head:
        if settings.classes or settings.class_groups:
            raise InputError("perception.head: has classes of its own; leave out perception.classes and class_groups")
        return load_head(Path(settings.head), load_trunk(settings))
    names, members = _reported(settings)
    return ClassifierNetwork(load_trunk(settings), names, members)


def load_trunk(settings: PerceptionConfiguration) -> DropoutNetwork:
    """Load the configured network of ``NETWORKS`` alone, whichever classes are reported. Raises InputError."""
    if settings.architecture not in NETWORKS:
        raise InputError(
            f"perception.architecture: {settings.architecture} is no ImageNet network; set one of {', '.join(NETWORKS)}"
        )
    return NETWORKS[settings.architecture](settings)


def _reported(settings: PerceptionConfiguration) -> tuple[tuple[str, ...], tuple[tuple[int, ...], ...]]:
    """Reported classes by name; or AlexNet outputs by number, without a rest class. Raises InputError."""
    if settings.architecture != alexnet.ARCHITECTURE or settings.classes or settings.class_groups:
        return reported_classes(settings)
    components = settings.alexnet_components
    if not components or not all(0 <= index < NUM_CLASSES for index in components):
        raise InputError(
            f"perception.alexnet_components: {list(components)} must be ImageNet classes 0 to {NUM_CLASSES - 1}"
        )
    return tuple(f"imagenet_{index}" for index in components), each_alone(components)


def _alexnet(settings: PerceptionConfiguration) -> DropoutNetwork:
    path = _named_file(settings)
    network = alexnet.AlexNet()
    load_strictly(network, read_weights(path), path)
    return network


def _squeezenet(settings: PerceptionConfiguration) -> DropoutNetwork:
    path = _named_file(settings)
    tensors = read_weights(path)
    network = squeezenet.SqueezeNet(of_torchvision=squeezenet.is_of_torchvision(set(tensors)))
    load_strictly(network, {squeezenet.renamed(name): tensor for name, tensor in tensors.items()}, path)
    return network


def _efficientnet_lite(settings: PerceptionConfiguration) -> DropoutNetwork:
    network = efficientnet_lite.EfficientNetLite()
    path = Path(settings.network) if settings.network else efficientnet_lite.packaged_weights()
    load_strictly(network, {f"whole.{name}": tensor for name, tensor in read_weights(path).items()}, path)
    return network


def _named_file(settings: PerceptionConfiguration) -> Path:
    if not settings.network:
        raise InputError(
            f"perception.network: {settings.architecture} has no shipped weights; name a torchvision state dict (.pth)"
        )
    return Path(settings.network)


NETWORKS: dict[str, Callable[[PerceptionConfiguration], DropoutNetwork]] = {
    alexnet.ARCHITECTURE: _alexnet,
    squeezenet.ARCHITECTURE: _squeezenet,
    efficientnet_lite.ARCHITECTURE: _efficientnet_lite,
}
"""Loader of each architecture's weights in evaluation mode; loaders raise InputError."""
