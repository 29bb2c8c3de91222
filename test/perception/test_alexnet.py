"""AlexNet with torchvision's state dict: strict, never executed, chosen ImageNet components as features."""

import os
import pickle
from pathlib import Path

import numpy as np
import pytest
import torch

from semantic_slam.configuration import Configuration, PerceptionConfiguration, SemanticModelConfiguration
from semantic_slam.errors import InputError
from semantic_slam.perception.frame import CameraModel, Detections, Frame
from semantic_slam.perception.networks.alexnet import AlexNet
from semantic_slam.pipeline.build_classifier import build_classifier

TORCHVISION_SHAPES = {
    "features.0.weight": (64, 3, 11, 11),
    "features.0.bias": (64,),
    "features.3.weight": (192, 64, 5, 5),
    "features.3.bias": (192,),
    "features.6.weight": (384, 192, 3, 3),
    "features.6.bias": (384,),
    "features.8.weight": (256, 384, 3, 3),
    "features.8.bias": (256,),
    "features.10.weight": (256, 256, 3, 3),
    "features.10.bias": (256,),
    "classifier.1.weight": (4096, 9216),
    "classifier.1.bias": (4096,),
    "classifier.4.weight": (4096, 4096),
    "classifier.4.bias": (4096,),
    "classifier.6.weight": (1000, 4096),
    "classifier.6.bias": (1000,),
}


@pytest.fixture(scope="module")
def weights_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Weights of the right names and shapes, as torchvision would save them."""
    generator = torch.Generator().manual_seed(0)
    tensors = {name: 0.02 * torch.randn(shape, generator=generator) for name, shape in TORCHVISION_SHAPES.items()}
    path = tmp_path_factory.mktemp("alexnet") / "alexnet.pth"
    torch.save(tensors, path)
    return path


def configured(path: Path, components: tuple[int, ...] = (3, 9, 504)) -> Configuration:
    settings = PerceptionConfiguration(
        network=str(path), architecture="alexnet", alexnet_components=components, num_passes=5
    )
    return Configuration(perception=settings, semantic_model=SemanticModelConfiguration(kind="none"))


def test_has_torchvisions_keys_and_size() -> None:
    with torch.device("meta"):
        network = AlexNet()
    assert {name: tuple(tensor.shape) for name, tensor in network.state_dict().items()} == TORCHVISION_SHAPES
    assert sum(tensor.numel() for tensor in network.parameters()) == 61_100_840


@pytest.mark.long
@pytest.mark.slow
def test_chosen_components_are_the_features(weights_file: Path) -> None:
    image = np.random.default_rng(0).integers(0, 256, (240, 320, 3), dtype=np.uint8)
    detections = Detections(
        stamp_ns=0,
        frame_id="camera",
        boxes=np.array([[10.0, 10.0, 200.0, 200.0]]),
        labels=("thing",),
        scores=np.ones(1),
        track_ids=("",),
    )
    frame = Frame(0, image, None, CameraModel(320, 240, 250.0, 250.0, 160.0, 120.0), detections)
    forward = np.array([0.0, 0.0, 0.0, -0.5, 0.5, -0.5, 0.5])
    classifier = build_classifier(configured(weights_file))
    some = classifier.measure(frame, 0, forward)
    every = build_classifier(configured(weights_file, tuple(range(1000)))).measure(frame, 0, forward)
    assert classifier.class_names == ("imagenet_3", "imagenet_9", "imagenet_504")
    assert classifier.num_features == 3
    np.testing.assert_array_equal(some.class_probability_samples, every.class_probability_samples[:, :, [3, 9, 504]])
    np.testing.assert_allclose(every.class_probability_samples.sum(axis=-1), 1.0)
    np.testing.assert_array_equal(some.predictive_entropy, every.predictive_entropy)
    assert some.predictive_entropy[0] > np.log(10.0)  # over all thousand classes, of an untrained network


@pytest.mark.long
@pytest.mark.slow
def test_a_missing_tensor_is_an_error(weights_file: Path, tmp_path: Path) -> None:
    tensors = torch.load(weights_file, weights_only=True)
    del tensors["classifier.6.bias"]
    path = tmp_path / "incomplete.pth"
    torch.save(tensors, path)
    with pytest.raises(InputError, match=r"incomplete\.pth: .*classifier\.6\.bias"):
        build_classifier(configured(path))


class _Payload:
    def __init__(self, victim: Path) -> None:
        self.victim = victim

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.mkdir, (str(self.victim),)


def test_a_file_with_code_is_refused_and_not_run(tmp_path: Path) -> None:
    path, victim = tmp_path / "evil.pth", tmp_path / "executed"
    path.write_bytes(pickle.dumps(_Payload(victim)))
    with pytest.raises(InputError, match=r"evil\.pth: "):
        build_classifier(configured(path))
    assert not victim.exists()
    torch.save({"features.0.weight": _Payload(victim)}, path)
    with pytest.raises(InputError, match=r"evil\.pth: ") as error:
        build_classifier(configured(path))
    assert not victim.exists()
    assert "\n" not in str(error.value)


@pytest.mark.slow
@pytest.mark.parametrize("components", [(), (-1,), (1000,)])
def test_components_must_be_imagenet_classes(weights_file: Path, components: tuple[int, ...]) -> None:
    with pytest.raises(InputError, match="alexnet_components"):
        build_classifier(configured(weights_file, components))


def test_alexnet_without_weights_says_what_to_do() -> None:
    with pytest.raises(InputError, match="torchvision state dict"):
        build_classifier(Configuration(perception=PerceptionConfiguration(architecture="alexnet")))
