"""A head for classes of one's own on the trunk of an ImageNet network: what it computes, and which trunk it is for."""

from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.numpy import save_file
from worlds.networks import squeezenet_file

from semantic_slam.configuration import PerceptionConfiguration
from semantic_slam.errors import InputError
from semantic_slam.perception.networks.digest import network_digest, weights_digest
from semantic_slam.perception.networks.head import Head, save_head, with_head
from semantic_slam.perception.networks.imagenet_networks import load_trunk
from semantic_slam.perception.networks.mc_dropout import class_probability_samples, dropout_generator
from semantic_slam.perception.networks.network import ClassifierNetwork
from semantic_slam.perception.networks.weights import load_network

NAMES = ("mug", "kettle", "lamp")
NUM_PASSES = 20


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return squeezenet_file(tmp_path_factory.mktemp("squeezenet") / "squeezenet.pth", seed=0)


@pytest.fixture(scope="module")
def trunk(weights: Path) -> PerceptionConfiguration:
    return PerceptionConfiguration(architecture="squeezenet", network=str(weights))


@pytest.fixture(scope="module")
def own(trunk: PerceptionConfiguration) -> ClassifierNetwork:
    """A head with random weights."""
    torch.manual_seed(1)
    head = Head(512, len(NAMES))
    head.mean.fill_(0.3)
    head.scale.fill_(2.0)
    head.requires_grad_(False)
    return with_head(load_trunk(trunk), head, NAMES)


@pytest.fixture(scope="module")
def head_file(own: ClassifierNetwork, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("head") / "head.safetensors"
    save_head(own, {"command": "a test"}, path)
    return path


def crop() -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (224, 224, 3), dtype=np.uint8)


def test_a_pass_is_the_head_on_standardised_roots_of_the_pooled_trunk(
    own: ClassifierNetwork, trunk: PerceptionConfiguration
) -> None:
    samples = class_probability_samples(own.network, crop(), NUM_PASSES, dropout_generator(0, 0, 0))
    network, generator = load_trunk(trunk), dropout_generator(0, 0, 0)
    with torch.inference_mode():
        features = network.trunk(network.normalise(crop()[None]))[0].double().numpy().mean(axis=(1, 2))
    first, second = (own.network.head()[index] for index in (1, 4))
    values = np.tile((np.sqrt(features) - 0.3) / 2.0, (NUM_PASSES, 1))
    values = values * (generator.random(values.shape, dtype=np.float32) >= 0.5) / 0.5
    values = np.maximum(values @ first.weight.numpy().T + first.bias.numpy(), 0.0)
    values = values * (generator.random(values.shape, dtype=np.float32) >= 0.5) / 0.5
    logits = values @ second.weight.numpy().T + second.bias.numpy()
    expected = np.exp(logits) / np.exp(logits).sum(axis=1, keepdims=True)
    np.testing.assert_allclose(samples, expected, atol=1e-5)
    assert np.ptp(samples, axis=0).max() > 0.01  # the masks differ


def test_a_head_from_its_file_gives_the_same_scores(
    own: ClassifierNetwork, trunk: PerceptionConfiguration, head_file: Path
) -> None:
    settings = PerceptionConfiguration(architecture="squeezenet", network=trunk.network, head=str(head_file))
    loaded = load_network(settings)
    assert loaded.class_names == NAMES
    assert network_digest(loaded) == network_digest(own)
    here, there = (
        class_probability_samples(classifier.network, crop(), NUM_PASSES, dropout_generator(0, 0, 0))
        for classifier in (own, loaded)
    )
    np.testing.assert_array_equal(here, there)


def test_a_head_on_another_trunk_is_refused(head_file: Path, tmp_path: Path) -> None:
    other = squeezenet_file(tmp_path / "other.pth", seed=1)
    with pytest.raises(InputError, match=r"head\.safetensors: trained on another network") as fault:
        load_network(PerceptionConfiguration(architecture="squeezenet", network=str(other), head=str(head_file)))
    assert "\n" not in str(fault.value)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"architecture": "squeezenet", "classes": ("cup",)}, "leave out perception.classes"),
        ({"architecture": "compact", "network": ""}, "only for an ImageNet network"),
    ],
)
def test_a_head_beside_what_it_replaces_is_one_line(
    settings: dict[str, object], words: str, trunk: PerceptionConfiguration, head_file: Path
) -> None:
    values = {"network": trunk.network, "head": str(head_file)} | settings
    with pytest.raises(InputError, match=words) as fault:
        load_network(PerceptionConfiguration(**values))
    assert "\n" not in str(fault.value)


def test_a_file_that_is_no_head_is_one_line(trunk: PerceptionConfiguration, tmp_path: Path) -> None:
    path = tmp_path / "nothing.safetensors"
    save_file({"mean": np.zeros(512, dtype=np.float32)}, str(path))
    with pytest.raises(InputError, match=r"nothing\.safetensors: .*perception\.head") as fault:
        load_network(PerceptionConfiguration(architecture="squeezenet", network=trunk.network, head=str(path)))
    assert "\n" not in str(fault.value)


def test_the_digest_is_of_weights_and_groups_and_not_of_passes(trunk: PerceptionConfiguration, tmp_path: Path) -> None:
    def digest(network: str, *classes: str, groups: str = "", num_passes: int = 50) -> str:
        settings = PerceptionConfiguration(
            architecture="squeezenet", network=network, classes=classes, class_groups=groups, num_passes=num_passes
        )
        return network_digest(load_network(settings))

    first = digest(trunk.network, "cup", "teddy")
    assert first == digest(trunk.network, "cup", "teddy", num_passes=3)
    assert first != digest(trunk.network, "cup", "desk")
    groups = tmp_path / "groups.yaml"
    groups.write_text("cup: [cup, coffee mug]\n")
    assert first != digest(trunk.network, "teddy", groups=str(groups))
    other = str(squeezenet_file(tmp_path / "other.pth", seed=1))
    assert first != digest(other, "cup", "teddy")
    one, two = (
        load_trunk(PerceptionConfiguration(architecture="squeezenet", network=path)) for path in (trunk.network, other)
    )
    assert weights_digest(one) != weights_digest(two)
