"""ONNX files of networks that see colours: every cell of the picture reports a box, scored by the cell's colour."""

import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch

from semantic_slam.geometry.arrays import Bytes

CELL = 8
"""Side of a cell in pixels of the input. The box of a cell is the cell; NanoDet's is twice as wide."""
COLOURS = ("red", "green", "blue")
"""Classes, in the order of a picture's channels."""
OBJECTNESS = 0.75
"""Of every box of yolov5's layout."""


class ColourDetector(torch.nn.Module):
    """Detector with the outputs of a layout."""

    def __init__(self, layout: str) -> None:
        super().__init__()
        self.layout = layout

    def forward(self, pictures: torch.Tensor) -> "torch.Tensor | tuple[torch.Tensor, ...]":
        """Outputs for (1, 3, H, W) pictures."""
        scores = torch.nn.functional.avg_pool2d(pictures, CELL)  # (1, 3, rows, columns)
        one = torch.ones_like(scores[:, :1])
        x, y, side = (torch.cumsum(one, 3) - 0.5) * CELL, (torch.cumsum(one, 2) - 0.5) * CELL, one * CELL
        return getattr(self, f"_{self.layout}")(x, y, side, scores)

    def _yolov5(self, x, y, side, scores):
        return columns(x, y, side, side, torch.ones_like(x) * OBJECTNESS, scores).transpose(1, 2)

    def _yolov5_with_grids(self, x, y, side, scores):
        return self._yolov5(x, y, side, scores), scores[:, None]

    def _yolov8(self, x, y, side, scores):
        return columns(x, y, side, side, scores)

    def _yolov8_rows(self, x, y, side, scores):
        return columns(x, y, side, side, scores).transpose(1, 2)

    def _one_class(self, x, y, side, scores):
        """YOLOv5's layout; the class is "red"."""
        return columns(x, y, side, side, torch.ones_like(x) * OBJECTNESS, scores[:, :1]).transpose(1, 2)

    def _two_classes_in_rows(self, x, y, side, scores):
        return columns(x, y, side, side, scores[:, :2]).transpose(1, 2)

    def _yolov8_shares(self, x, y, side, scores):
        """Boxes in shares of a 64 pixels' input."""
        return columns(x / 64, y / 64, side / 64, side / 64, scores)

    def _end_to_end(self, x, y, side, scores):
        best, number = scores.max(dim=1, keepdim=True)
        half = side / 2
        return columns(x - half, y - half, x + half, y + half, best, number.to(best.dtype)).transpose(1, 2)

    def _end_to_end_shares(self, x, y, side, scores):
        """Boxes in shares of a 64 pixels' input."""
        return self._end_to_end(x / 64, y / 64, side / 64, scores)

    def _end_to_end_logits(self, x, y, side, scores):
        return self._end_to_end(x, y, side, 20.0 * (scores - 0.5))

    def _yolov8_logits(self, x, y, side, scores):
        return self._yolov8(x, y, side, 20.0 * (scores - 0.5))

    def _nanodet(self, x, y, side, scores):
        scores = scores.sigmoid()  # its normalisation leaves -2 to 3
        bins = torch.tensor([0.0, 1000.0, 0.0, 0.0]).repeat(4).reshape(1, -1, 1, 1)  # one cell to all sides
        return columns(scores).transpose(1, 2), columns(bins * torch.ones_like(x)).transpose(1, 2)


def columns(*maps: torch.Tensor) -> torch.Tensor:
    """(1, columns, cells) of maps of the cells."""
    return torch.cat(maps, dim=1).flatten(2)


def write_network(path: Path, layout: str, size: tuple[int, int] = (64, 64), open_sizes: Sequence[int] = ()) -> Path:
    """Write a network for pictures of ``size`` (height, width); its file leaves open the dimensions ``open_sizes``."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # this exporter, which needs no other package, is the former one
        torch.onnx.export(
            ColourDetector(layout),
            (torch.zeros(1, 3, *size),),
            str(path),
            dynamo=False,
            opset_version=17,
            input_names=["images"],
            dynamic_axes={"images": {axis: f"size_{axis}" for axis in open_sizes}} if open_sizes else None,
        )
    return path


def black_with_block(shape: tuple[int, int], box: Sequence[int], colour: str) -> Bytes:
    """(H, W, 3) RGB picture with a block of full colour, x_min y_min x_max y_max in pixels."""
    picture = np.zeros((*shape, 3), dtype=np.uint8)
    picture[box[1] : box[3], box[0] : box[2], COLOURS.index(colour)] = 255
    return picture
