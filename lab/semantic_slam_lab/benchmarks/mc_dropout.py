"""MC dropout through networks of ImageNet: T passes that share the trunk, against whole passes and a single one."""

from collections.abc import Callable

import numpy as np
import torch
from torch import nn

from semantic_slam.geometry.arrays import Bytes
from semantic_slam.perception.networks.alexnet import AlexNet
from semantic_slam.perception.networks.efficientnet_lite import EfficientNetLite
from semantic_slam.perception.networks.mc_dropout import class_probability_samples, dropout_generator
from semantic_slam.perception.networks.squeezenet import SqueezeNet
from semantic_slam_lab.benchmarks.row import Row, alternated

NUM_PASSES = 50
Call = Callable[[], None]


def passes(quick: bool, seed: int) -> list[Row]:
    """T = 50 as our classifier draws them, one plain pass, and 50 whole passes with dropout; weights are random."""
    torch.manual_seed(seed)
    repetitions = 3 if quick else 9
    alexnet = AlexNet().eval()
    ours, once = _calls(alexnet, seed)

    def loop() -> None:
        alexnet.train()
        for _ in range(NUM_PASSES):
            once()
        alexnet.eval()

    ours()
    again, looped = alternated(ours, loop, 2 if quick else 5)
    how = f"AlexNet-224, T = {NUM_PASSES}, one crop, one thread; 50 passes"
    return [
        Row("mc_dropout_vs_loop", again * 1e3, looped * 1e3, "ms", looped / again, repetitions, how),
        _against_one_pass("mc_dropout_vs_one_pass", "AlexNet-224", alexnet, repetitions, seed),
        _against_one_pass(
            "mc_dropout_vs_one_pass_efficientnet",
            "EfficientNet-Lite0",
            EfficientNetLite().eval(),
            repetitions,
            seed,
        ),
        _against_one_pass(
            "mc_dropout_vs_one_pass_squeezenet",
            "SqueezeNet 1.1, dropout before a convolution over the whole map",
            SqueezeNet(of_torchvision=True).eval(),
            repetitions,
            seed,
        ),
    ]


def _against_one_pass(name: str, title: str, network: nn.Module, repetitions: int, seed: int) -> Row:
    ours, once = _calls(network, seed)
    ours()
    once()
    mine, plain = alternated(ours, once, repetitions)
    how = f"{title}, T = {NUM_PASSES}, one crop, one thread; one pass"
    return Row(name, mine * 1e3, plain * 1e3, "ms", mine / plain, repetitions, how)


def _calls(network: nn.Module, seed: int) -> tuple[Call, Call]:
    """T passes that share the trunk, and one whole pass, over the same crop."""
    crop: Bytes = np.random.default_rng(seed).integers(
        0, 256, (network.input_size, network.input_size, 3), dtype=np.uint8
    )

    def ours() -> None:
        class_probability_samples(network, crop, NUM_PASSES, dropout_generator(seed, 0, 0))

    def once() -> None:
        with torch.inference_mode():
            torch.softmax(network(network.normalise(crop[None])), dim=-1)

    return ours, once
