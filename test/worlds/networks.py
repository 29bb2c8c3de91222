"""Weight files of ImageNet networks with random weights, in the layouts that their users have them."""

from pathlib import Path

import torch

SQUEEZENET_WIDTHS = {3: (64, 16, 64), 4: (128, 16, 64), 6: (128, 32, 128), 7: (256, 32, 128)}
SQUEEZENET_WIDTHS |= {9: (256, 48, 192), 10: (384, 48, 192), 11: (384, 64, 256), 12: (512, 64, 256)}
"""Fire module of torchvision's squeezenet1_1 -> channels of input, squeezed, and of each expanded half."""


def squeezenet_tensors(seed: int = 0) -> dict[str, torch.Tensor]:
    """A state dict with the names and shapes of torchvision's squeezenet1_1."""
    shapes: dict[str, tuple[int, ...]] = {"features.0": (64, 3, 3, 3), "classifier.1": (1000, 512, 1, 1)}
    for index, (inputs, squeezed, expanded) in SQUEEZENET_WIDTHS.items():
        shapes[f"features.{index}.squeeze"] = (squeezed, inputs, 1, 1)
        shapes[f"features.{index}.expand1x1"] = (expanded, squeezed, 1, 1)
        shapes[f"features.{index}.expand3x3"] = (expanded, squeezed, 3, 3)
    generator = torch.Generator().manual_seed(seed)
    weights = {f"{name}.weight": 0.1 * torch.randn(shape, generator=generator) for name, shape in shapes.items()}
    return weights | {f"{name}.bias": torch.zeros(shape[0]) for name, shape in shapes.items()}


def squeezenet_file(path: Path, seed: int) -> Path:
    """Write such a state dict as torch.save does."""
    torch.save(squeezenet_tensors(seed), path)
    return path
