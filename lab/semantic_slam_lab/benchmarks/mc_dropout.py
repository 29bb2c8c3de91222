"""MC dropout through AlexNet-224: T passes that share the trunk, against whole passes."""

import numpy as np
import torch

from semantic_slam.perception.alexnet import AlexNet
from semantic_slam.perception.mc_dropout import class_probability_samples, dropout_generator
from semantic_slam_lab.benchmarks.row import Row, alternated

NUM_PASSES = 50


def passes(quick: bool, seed: int) -> list[Row]:
    """T = 50 as our classifier draws them, one plain pass, and 50 whole passes with dropout."""
    torch.manual_seed(seed)
    network = AlexNet().eval()
    crop = np.random.default_rng(seed).integers(0, 256, (224, 224, 3), dtype=np.uint8)

    def ours() -> None:
        class_probability_samples(network, crop, NUM_PASSES, dropout_generator(seed, 0, 0))

    def once() -> None:
        with torch.inference_mode():
            torch.softmax(network(network.normalise(crop[None])), dim=-1)

    def loop() -> None:
        network.train()
        for _ in range(NUM_PASSES):
            once()
        network.eval()

    ours()
    repetitions = 3 if quick else 9
    mine, plain = alternated(ours, once, repetitions)
    again, looped = alternated(ours, loop, 2 if quick else 5)
    setting = f"AlexNet-224, T = {NUM_PASSES}, one crop, one thread"
    return [
        Row(
            "mc_dropout_vs_loop", again * 1e3, looped * 1e3, "ms", looped / again, repetitions, f"{setting}; 50 passes"
        ),
        Row("mc_dropout_vs_one_pass", mine * 1e3, plain * 1e3, "ms", mine / plain, repetitions, f"{setting}; one pass"),
    ]
